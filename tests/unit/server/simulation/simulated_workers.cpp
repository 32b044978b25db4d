// Workers of the simulated server.
#include <algorithm>
#include <chrono>

#include "absl/strings/str_cat.h"
#include "tests/unit/server/simulation/simulated_server.h"
#include "tests/unit/server/simulation/simulated_streams.h"
#include "tests/unit/server/simulation/small_jobs.h"

namespace tessera::server {

using namespace std::chrono_literals;

namespace {

constexpr double kLoadSeconds = 0.05;  // of a scene; it has paid off after one unit
constexpr Duration kWelcomeTimeout = 3s, kSendAgainAfter = 5s;

}  // namespace

void SimulatedServer::connect(Computer& computer) {
  Hello hello;
  hello.worker_id = hello.name = hello.host = computer.id;
  hello.thread_count = computer.threads;
  hello.store_id = store_->id();
  hello.credit_count = std::max(0, computer.credits - static_cast<int>(computer.held.size()));
  std::set<Attempt> attempts;
  for (auto& [name, held] : computer.held) {
    (held.sent ? hello.unacknowledged : hello.running).push_back(name);
    if (attempts.insert(held.lease.attempt).second) hello.leases.push_back(held.lease);
    held.sent.reset();  // it is sent again
  }
  const auto link = std::make_shared<Link>(*this);
  computer.link = link;
  computer.opened = now_;
  network_.send(link->up, now_, [this, &computer, link, hello] {
    if (link->is_ended) return;  // the server has seen that the worker has left
    if (computer.link != link) ++events_.late_hellos;
    link->session = coordinator_->workers().join(hello, link).session;
    links_.emplace_back(&computer, link);
    network_.send(link->down, now_, [&computer, link] {
      if (computer.link == link) computer.is_connected = true;
    });
  });
}

/// The worker uses its Work stream no more.
void SimulatedServer::leave(Computer& computer) {
  if (computer.link != nullptr) break_link(*computer.link);
  computer.link.reset();
  computer.is_connected = false;
}

/// The connection is gone. Some messages of it still arrive; the server may see its end, at any
/// time, or not.
void SimulatedServer::break_link(Link& link) {
  if (link.is_broken) return;
  link.is_broken = true;
  network_.cut(link.up);
  network_.cut(link.down);
  if (dice_.one_in(2)) return;
  network_.send(now_, [this, open = link.shared_from_this()] { end(*open); });
}

void SimulatedServer::lose_connections(Computer& computer, bool is_calm) {
  if (computer.link != nullptr && !is_calm && dice_.one_in(40)) {
    ++events_.broken_streams;
    break_link(*computer.link);
  }
  if (computer.link != nullptr && computer.link->is_broken && (is_calm || dice_.one_in(2))) {
    leave(computer);
  }
  if (computer.link != nullptr && !computer.is_connected &&
      now_ - computer.opened > kWelcomeTimeout) {
    leave(computer);
  }
  if (computer.upload == nullptr) return;
  if (computer.upload->is_ended || (!is_calm && dice_.one_in(40))) {
    network_.cut(computer.upload->stream);
    computer.upload.reset();
  }
}

void SimulatedServer::act_as_worker(Computer& computer, bool is_calm) {
  if (!computer.is_up) {
    computer.is_up = is_calm || dice_.one_in(5);
    return;
  }
  if (!is_calm && dice_.one_in(is_shared_ ? 300 : 80)) {  // its process dies
    ++events_.worker_crashes;
    leave(computer);
    if (computer.upload != nullptr) network_.cut(computer.upload->stream);
    computer.upload.reset();
    computer.is_up = false;
    computer.held.clear();
    computer.scene = {};
    return;
  }
  lose_connections(computer, is_calm);
  if (computer.link == nullptr) {
    if (is_calm || dice_.one_in(3)) connect(computer);
    return;
  }
  if (computer.is_connected) work(computer, is_calm);
}

/// Sends a message on the Work stream.
void SimulatedServer::tell(const Computer& computer, std::function<void(Session)> arrive) {
  const std::shared_ptr<Link> link = computer.link;
  network_.send(link->up, now_, [link, arrive = std::move(arrive)] {
    if (link->session) arrive(*link->session);
  });
}

/// Reports that a scene is loaded when the first unit of a frame begins.
void SimulatedServer::note_scene(Computer& computer, const UnitName& name) {
  const std::pair scene{name.job_id, name.unit.frame};
  if (computer.scene == scene) return;
  computer.scene = scene;
  tell(computer, [this, job_id = name.job_id](Session session) {
    coordinator_->workers().scene_loaded(session, job_id, {kLoadSeconds, 0});
  });
}

void SimulatedServer::work(Computer& computer, bool is_calm) {
  int running = 0;
  std::vector<UnitName> started;
  for (auto& [name, held] : computer.held) {
    if (held.sent) continue;
    if (!held.ready && running < computer.threads) {
      held.ready = now_ + std::chrono::milliseconds(100 + dice_.below(is_shared_ ? 500 : 2000));
      started.push_back(name);
      note_scene(computer, name);
    }
    running += held.ready ? 1 : 0;
  }
  tell(computer, [this, started](Session session) {
    coordinator_->workers().heartbeat(session, started, 0);
  });
  for (auto& [name, held] : computer.held) {
    if (held.sent && now_ - *held.sent > kSendAgainAfter) held.sent.reset();
    if (held.sent || !held.ready || *held.ready > now_) continue;
    if (is_calm || !dice_.one_in(6)) deliver(computer, name, held, is_calm);
  }
}

void SimulatedServer::read_outbox(Computer& computer, const Outbox& outbox) {
  int credits = 0;
  for (const Acknowledgement& told : outbox.acknowledgements) {
    credits += static_cast<int>(computer.held.erase(told.unit));
    if (told.status == AckStatus::rejected && !is_audited_) {
      violate("a right block is rejected: " + told.reason);
    }
  }
  credits += give_back(computer, outbox.revoked);
  for (const Lease& lease : outbox.leases) take_lease(computer, lease);
  credits += give_back(computer, outbox.withdrawn);
  if (static_cast<int>(computer.held.size()) > computer.credits) {
    violate(absl::StrCat(computer.id, " is leased ", computer.held.size(), " units and granted ",
                         computer.credits, " credits"));
  }
  if (credits == 0) return;
  tell(computer, [this, credits](Session session) {
    coordinator_->workers().grant_credits(session, credits);
  });
}

/// Gives back revoked units that were not sent. Returns how many.
int SimulatedServer::give_back(Computer& computer, const std::vector<UnitName>& revoked) {
  std::vector<UnitName> returned;
  for (const UnitName& name : revoked) {
    const auto held = computer.held.find(name);
    if (held == computer.held.end() || held->second.sent) continue;
    computer.held.erase(held);
    returned.push_back(name);
  }
  if (!returned.empty()) {
    tell(computer, [this, returned](Session session) {
      coordinator_->workers().return_units(session, returned);
    });
  }
  return static_cast<int>(returned.size());
}

void SimulatedServer::take_lease(Computer& computer, const Lease& lease) {
  for (std::int32_t i = 0; i < lease.tile_count; ++i) {
    const UnitName name{lease.job_id, {lease.frame, lease.first_tile + i, lease.pass}};
    computer.held[name] = {lease, {}, {}};
    trace(absl::StrCat(computer.id, " is leased ", lease.job_id, " (", lease.frame, ", ",
                       name.unit.tile, ", ", lease.pass, "), attempt ", lease.attempt.boot, ".",
                       lease.attempt.counter));
  }
}

void SimulatedServer::deliver(Computer& computer, const UnitName& name, Held& held, bool is_calm) {
  int kind = -1;
  for (const auto& [request_id, job] : jobs_) kind = job.id == name.job_id ? job.kind : kind;
  if (kind < 0) {  // its client has not been told of the job yet
    const auto spec = coordinator_->queries().describe_job(name.job_id);
    if (spec == nullptr) return;
    kind = kind_of(*spec);
  }
  held.sent = now_;
  std::string bytes = block_of(small_job(kind, 8), name.unit, held.lease.sample_count);
  if (computer.is_faulty && dice_.one_in(3)) {
    bytes[2] = static_cast<char>(bytes[2] ^ 0x20);  // the first pixel's red
    ++events_.wrong_blocks;
  }
  const BlockHeader header{held.lease, name.unit.tile, static_cast<std::int64_t>(bytes.size()),
                           contract::sha256(bytes), kUnitSeconds};
  largest_block_ = std::max(largest_block_, header.size_bytes);
  const int times = !is_calm && dice_.one_in(15) ? 2 : 1;
  events_.repeated_blocks += times - 1;
  for (int i = 0; i < times; ++i) upload_block(computer, header, bytes);
}

/// Sends a block as two messages.
void SimulatedServer::upload_block(Computer& computer, const BlockHeader& header,
                                   const std::string& bytes) {
  if (computer.upload == nullptr) computer.upload = std::make_shared<Upload>(network_.open());
  const std::shared_ptr<Upload> upload = computer.upload;
  const auto admission = std::make_shared<std::optional<Admission>>();
  const auto send = [&](std::function<void()> take) {
    network_.send(upload->stream, now_, [this, upload, id = computer.id, take = std::move(take)] {
      receive(upload, [this, upload, id, take] {
        upload->is_ended = !coordinator_->intake().check_delivery(id).ok();
        if (!upload->is_ended) take();
      });
    });
  };
  send([this, admission, header, id = computer.id] {
    *admission = coordinator_->intake().admit(id, header);
  });
  send([this, admission, header, bytes, id = computer.id] {
    if (*admission) coordinator_->intake().deliver(id, header, **admission, bytes);
  });
}

}  // namespace tessera::server
