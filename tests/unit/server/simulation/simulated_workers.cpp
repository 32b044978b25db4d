// Workers of the simulated server.
#include <algorithm>
#include <chrono>

#include "absl/strings/str_cat.h"
#include "tests/unit/server/simulation/simulated_server.h"
#include "tests/unit/server/simulation/small_jobs.h"

namespace tessera::server {

using namespace std::chrono_literals;

class SimulatedServer::Link final : public WorkerConnection {
 public:
  void wake() override {}
  void close(const absl::Status& /*reason*/) override { is_closed = true; }
  bool is_closed = false;
};

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
  computer.link = std::make_shared<Link>();
  computer.session = coordinator_->workers().join(hello, computer.link).session;
  computer.is_connected = true;
}

void SimulatedServer::act_as_worker(Computer& computer, bool is_calm) {
  if (!computer.is_up) {
    computer.is_up = is_calm || dice_.one_in(5);
    return;
  }
  if (!is_calm && dice_.one_in(80)) {  // its process dies
    ++events_.worker_crashes;
    if (computer.is_connected && dice_.one_in(2)) {
      coordinator_->workers().disconnect(computer.session);
    }
    computer.is_up = computer.is_connected = false;
    computer.held.clear();
    return;
  }
  if (computer.is_connected && (computer.link->is_closed || (!is_calm && dice_.one_in(40)))) {
    ++events_.broken_streams;
    if (dice_.one_in(2)) coordinator_->workers().disconnect(computer.session);
    computer.is_connected = false;
  }
  if (!computer.is_connected) {
    if (is_calm || dice_.one_in(3)) connect(computer);
    return;
  }
  if (is_calm || !dice_.one_in(4)) read_outbox(computer);
  int running = 0;
  std::vector<UnitName> started;
  for (auto& [name, held] : computer.held) {
    if (held.sent) continue;
    if (!held.ready && running < computer.threads) {
      held.ready = now_ + std::chrono::milliseconds(100 + dice_.below(2000));
      started.push_back(name);
    }
    running += held.ready ? 1 : 0;
  }
  coordinator_->workers().heartbeat(computer.session, started, 0);
  for (auto& [name, held] : computer.held) {
    if (held.sent && now_ - *held.sent > 2s) held.sent.reset();  // no answer: it is sent again
    if (held.sent || !held.ready || *held.ready > now_) continue;
    if (is_calm || !dice_.one_in(6)) deliver(computer, name, held, is_calm);
  }
}

void SimulatedServer::read_outbox(Computer& computer) {
  const Outbox outbox = coordinator_->workers().take_outbox(computer.session);
  int credits = 0;
  for (const Acknowledgement& told : outbox.acknowledgements) {
    credits += static_cast<int>(computer.held.erase(told.unit));
    if (told.status == AckStatus::rejected && !is_audited_) {
      violate("a right block is rejected: " + told.reason);
    }
    if (told.status != AckStatus::committed) continue;
    ++events_.commits;
    trace(absl::StrCat(computer.id, " is told: ", told.unit.job_id, " (", told.unit.unit.frame,
                       ", ", told.unit.unit.tile, ", ", told.unit.unit.pass, ") is committed"));
    for (auto& [request_id, job] : jobs_) {
      if (job.id == told.unit.job_id) job.committed.insert(told.unit);
    }
  }
  credits += give_back(computer, outbox.revoked);
  for (const Lease& lease : outbox.leases) take_lease(computer, lease);
  credits += give_back(computer, outbox.withdrawn);
  if (credits > 0) coordinator_->workers().grant_credits(computer.session, credits);
  for (const Lease& lease : outbox.leases) check_lease(computer, lease);
}

/// A unit that was known as committed is not leased again, except for an audit.
void SimulatedServer::check_lease(const Computer& computer, const Lease& lease) {
  if (is_audited_) return;
  for (const auto& [request_id, job] : jobs_) {
    if (job.is_extended) continue;
    for (const UnitName& name : job.committed) {
      if (name.job_id != lease.job_id || !lease.covers(name.unit)) continue;
      if (computer.held.count(name) == 0) continue;  // it was withdrawn
      violate(absl::StrCat("unit (", name.unit.frame, ", ", name.unit.tile, ", ", name.unit.pass,
                           ") of job ", job.id, " was acknowledged and is leased again"));
    }
  }
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
  if (!returned.empty()) coordinator_->workers().return_units(computer.session, returned);
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
  held.sent = now_;
  if (!is_calm && dice_.one_in(15)) {
    ++events_.lost_blocks;
    return;
  }
  int kind = -1;
  for (const auto& [request_id, job] : jobs_) kind = job.id == name.job_id ? job.kind : kind;
  if (kind < 0) {  // its client has not been told of the job yet
    const auto spec = coordinator_->queries().describe_job(name.job_id);
    if (spec == nullptr) return;
    kind = kind_of(*spec);
  }
  std::string bytes = block_of(small_job(kind, 8), name.unit, held.lease.sample_count);
  if (computer.is_faulty && dice_.one_in(3)) {
    bytes[2] = static_cast<char>(bytes[2] ^ 0x20);  // the first pixel's red
    ++events_.wrong_blocks;
  }
  const BlockHeader header{held.lease, name.unit.tile, static_cast<std::int64_t>(bytes.size()),
                           contract::sha256(bytes), kUnitSeconds};
  const int times = !is_calm && dice_.one_in(15) ? 2 : 1;
  events_.repeated_blocks += times - 1;
  for (int i = 0; i < times; ++i) {
    const auto admission = coordinator_->intake().admit(computer.id, header);
    if (admission) coordinator_->intake().deliver(computer.id, header, *admission, bytes);
  }
}

}  // namespace tessera::server
