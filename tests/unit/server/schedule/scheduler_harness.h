#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "contract/digest.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

/// Digests of results.
inline const contract::Digest truth = contract::sha256("true"), wrong = contract::sha256("false");

/// A scheduler whose clock and workers the test controls.
class SchedulerHarness {
 public:
  explicit SchedulerHarness(const std::vector<std::string>& roster = {},
                            const SchedulePolicy& policy = {})
      : scheduler({"store", "key", 1}, policy, roster, now) {}

  /// A job of `tiles` 8x8 tiles in a row and of `frames` frames.
  struct JobPlanned {
    std::int32_t tiles = 16, frames = 1, spp = 8, priority = 0, max_workers = 0;
    std::string owner = "ann", tag = {};
    std::string scene = {};  // content of its only file
    std::string pool = {};
    std::vector<LimitUse> limits = {};
    std::vector<Dependency> after = {};
  };
  Job& add_job(const JobPlanned& planned) {
    Job& job = queue_job(planned);
    scheduler.dispatcher().dispatch_all(now);
    return job;
  }
  /// The same, but leases nothing of it yet.
  Job& queue_job(const JobPlanned& planned) {
    auto spec = std::make_shared<JobSpec>();
    const JobKey key = ++last_job_;
    spec->id = "j" + std::to_string(key);
    spec->owner = planned.owner;
    spec->priority = planned.priority;
    spec->max_workers = planned.max_workers;
    spec->required_tag = planned.tag;
    spec->pool = planned.pool;
    spec->limits = planned.limits;
    spec->after = planned.after;
    spec->assets = {{"scene.glb", contract::sha256(planned.scene), 0}};
    spec->settings.width = 8 * planned.tiles;
    spec->settings.height = 8;
    spec->settings.tile = 8;
    spec->settings.spp = planned.spp;
    spec->settings.frames = {{0, planned.frames - 1, 1}};
    return scheduler.changes().add_job(key, spec, JobState::queued);
  }

  struct WorkerPlanned {
    std::int32_t threads = 2, credits = 4;
    std::vector<std::string> tags = {};
    std::vector<Lease> leases = {};
    std::vector<UnitName> running = {}, unacknowledged = {};
    std::string store_id = "store";
    std::string certificate = {};
    std::string pool = {};
  };
  WorkerKey connect(const std::string& id, const WorkerPlanned& planned) {
    Hello hello;
    hello.worker_id = hello.name = id;
    hello.thread_count = planned.threads;
    hello.credit_count = planned.credits;
    hello.tags = planned.tags;
    hello.store_id = planned.store_id;
    hello.certificate = planned.certificate;
    hello.pool = planned.pool;
    hello.leases = planned.leases;
    hello.running = planned.running;
    hello.unacknowledged = planned.unacknowledged;
    return scheduler.connections().connect(hello, now);
  }
  WorkerKey connect(const std::string& id) { return connect(id, {}); }

  /// Returns the messages to the worker since the last call.
  Outbox outbox(WorkerKey worker) {
    return std::exchange(scheduler.workers().find(worker)->outbox, Outbox{});
  }
  /// Units of the worker's new leases, which are stored in `leases`.
  std::vector<UnitName> leased(WorkerKey worker) {
    std::vector<UnitName> units;
    for (const Lease& lease : outbox(worker).leases) {
      for (std::int32_t i = 0; i < lease.tile_count; ++i) {
        units.push_back({lease.job_id, {lease.frame, lease.first_tile + i, lease.pass}});
        leases[{worker, units.back()}] = lease;
      }
    }
    return units;
  }
  void start(WorkerKey worker, const std::vector<UnitName>& units) {
    scheduler.connections().heartbeat(worker, units, 0, now);
  }
  void commit(WorkerKey worker, const UnitName& unit, double cpu_seconds = 1) {
    scheduler.results().commit(*scheduler.jobs().find(unit.job_id), unit.unit,
                               scheduler.workers().find(worker)->id, cpu_seconds);
  }
  /// Commits and returns the credit, as a worker does after the acknowledgement.
  void complete(WorkerKey worker, const UnitName& unit, double cpu_seconds = 1) {
    commit(worker, unit, cpu_seconds);
    scheduler.connections().grant_credits(worker, 1, now);
  }
  void fail(WorkerKey worker, const UnitName& unit,
            absl::StatusCode code = absl::StatusCode::kInternal) {
    scheduler.failures().fail_unit(worker, leases.at({worker, unit}), unit.unit.tile,
                                   {"", "broke", "log"}, code, now);
    scheduler.connections().grant_credits(worker, 1, now);
  }
  /// Advances time in steps of 100 ms; `awake` workers send a heartbeat at each.
  void pass(std::chrono::milliseconds span, const std::vector<WorkerKey>& awake) {
    for (const Time end = now + span; now < end;) {
      now += kPeriod;
      for (const WorkerKey worker : awake) scheduler.connections().record_contact(worker, now);
      scheduler.tick(now, kPeriod);
    }
  }

  static constexpr std::chrono::milliseconds kPeriod{100};
  Time now{};
  Scheduler scheduler;
  std::map<std::pair<WorkerKey, UnitName>, Lease> leases;

 private:
  JobKey last_job_ = 0;
};

}  // namespace tessera::server
