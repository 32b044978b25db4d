// The server's ends of streams.
#include "tests/unit/server/simulation/simulated_streams.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {

/// A message that the server is reading is still taken, with the session that has ended.
void SimulatedServer::Link::close(const absl::Status& /*reason*/) {
  is_ended = true;
  server_.network_.send(down, server_.now_,
                        [open = shared_from_this()] { open->is_broken = true; });
}

/// The server sees the end of a stream.
void SimulatedServer::end(Link& link) {
  link.is_ended = true;
  if (link.session) coordinator_->workers().disconnect(*link.session);
  link.session.reset();
}

void SimulatedServer::send_outboxes(bool is_calm) {
  std::erase_if(links_, [](const auto& each) { return each.second->is_ended; });
  for (const auto& [computer, link] : links_) {
    if (!is_calm && dice_.one_in(4)) continue;  // the stream is still writing
    Outbox outbox = coordinator_->workers().take_outbox(*link->session);
    if (outbox.empty()) continue;
    note_sent(*computer, outbox);
    network_.send(link->down, now_,
                  [this, computer = computer, link = link, outbox = std::move(outbox)] {
                    if (computer->link == link) read_outbox(*computer, outbox);
                  });
  }
}

/// Notes what the server acknowledges. What has been acknowledged as committed is not acknowledged
/// so again, and not leased again, except for an audit.
void SimulatedServer::note_sent(const Computer& computer, const Outbox& outbox) {
  fairness_->note_sent(computer.id, outbox.leases);
  const FarmView farm(coordinator_->farm());
  const auto is_exempt = [this](const std::string& job_id) {
    return is_audited_ || std::any_of(jobs_.begin(), jobs_.end(), [&](const auto& entry) {
             return entry.second.id == job_id && entry.second.is_extended;
           });
  };
  for (const Acknowledgement& told : outbox.acknowledgements) {
    if (told.status != AckStatus::committed) continue;
    ++events_.commits;
    const std::string name = absl::StrCat(told.unit.job_id, " (", told.unit.unit.frame, ", ",
                                          told.unit.unit.tile, ", ", told.unit.unit.pass, ")");
    trace(absl::StrCat(computer.id, " is told: ", name, " is committed"));
    const Attempt newest = farm.scheduler().last_attempt();
    const bool is_new = committed_[told.unit.job_id].emplace(told.unit.unit, newest).second;
    if (!is_new && !is_exempt(told.unit.job_id)) violate("unit " + name + " is committed twice");
  }
  for (const Lease& lease : outbox.leases) {
    const auto committed = committed_.find(lease.job_id);
    if (committed == committed_.end()) continue;
    for (std::int32_t i = 0; i < lease.tile_count; ++i) {
      const auto unit = committed->second.find({lease.frame, lease.first_tile + i, lease.pass});
      if (unit == committed->second.end() || lease.attempt <= unit->second) continue;
      if (is_exempt(lease.job_id)) continue;
      violate(absl::StrCat("unit (", lease.frame, ", ", lease.first_tile + i, ", ", lease.pass,
                           ") of job ", lease.job_id, " was acknowledged and is leased again"));
    }
  }
}

void SimulatedServer::receive(const std::shared_ptr<Upload>& upload, std::function<void()> take) {
  if (upload->is_ended) return;
  if (std::find(uploads_.begin(), uploads_.end(), upload) == uploads_.end()) {
    uploads_.push_back(upload);
  }
  upload->unread.push_back(std::move(take));
  read(upload);
}

/// Takes messages while there is room for blocks.
void SimulatedServer::read(const std::shared_ptr<Upload>& upload) {
  while (!upload->is_waiting && !upload->is_ended && !upload->unread.empty()) {
    const std::function<void()> take = std::move(upload->unread.front());
    upload->unread.pop_front();
    take();
    upload->is_waiting = true;
    if (coordinator_->intake().has_room_or_call([upload] { upload->is_waiting = false; })) {
      upload->is_waiting = false;
    } else {
      ++events_.full_ingests;
    }
  }
}

void SimulatedServer::read_uploads() {
  for (const std::shared_ptr<Upload>& upload : uploads_) read(upload);
  std::erase_if(uploads_, [](const std::shared_ptr<Upload>& upload) {
    return upload->is_ended || upload->unread.empty();
  });
}

}  // namespace tessera::server
