// Compares the scheduler's indexes with what they are made from.
#include <algorithm>

#include "absl/strings/str_cat.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

using contract::Unit;

namespace {

absl::Status differs(const std::string& what) {
  return absl::InternalError(absl::StrCat("scheduler: ", what));
}

/// Returns the difference of two counts of the farm, or "".
std::string difference(const FarmCensus& census, const FarmCensus& recount,
                       const std::string& tag) {
  const FarmCensus::Count* one = census.find(tag);
  const FarmCensus::Count* other = recount.find(tag);
  if ((one == nullptr) != (other == nullptr)) return "a tag is missing";
  if (one == nullptr) return "";
  if (one->threads != other->threads) return "threads";
  if (one->hosts != other->hosts) return "hosts";
  return one->witnesses == other->witnesses ? "" : "witnesses";
}

}  // namespace

absl::Status Scheduler::verify_job(const Job& job) const {
  const auto wrong = [&](const char* what) {
    return differs(absl::StrCat("job ", job.spec->id, ": ", what));
  };
  const bool is_runnable = job.is_runnable();
  if (queued_.count(job.key) != (is_runnable && !is_full(job) ? 1U : 0U)) return wrong("queued");
  if (full_.count(job.key) != (is_runnable && is_full(job) ? 1U : 0U)) return wrong("full");
  std::map<WorkerKey, std::int32_t> holders;
  if (job.plan) {
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      for (const Holder& holder : in_flight.holders) {
        ++holders[holder.worker];
        const auto worker = workers_.find(holder.worker);
        if (worker == workers_.end() || !holds(worker->second, job, unit)) return wrong("a holder");
      }
    }
  }
  if (holders != job.holders) return wrong("holders");
  for (const auto& [unit, audit] : job.audits) {
    if (!job.plan || !job.plan->is_committed(unit)) return wrong("audit of a unit not committed");
    const bool waits = !audit.holder && job.state != JobState::paused && !has_ended(job.state);
    if (audit.group.has_value() != waits) return wrong("an audit that waits");
  }
  if (has_ended(job.state) && !holders.empty()) return wrong("units at its end");
  for (const std::int32_t frame : contract::frame_list(job.spec->settings.frames)) {
    const bool is_blocked = is_frame_blocked(job, frame);
    if (is_blocked != (job.blocked_frames.count(frame) > 0)) return wrong("blocked frames");
    if (job.plan && job.plan->is_held_back(frame) != is_blocked) return wrong("held back frames");
  }
  const bool is_blocked = std::any_of(
      job.spec->after.begin(), job.spec->after.end(),
      [this](const Dependency& each) { return state_of(each) != DependencyState::met; });
  if (is_blocked != job.is_blocked) return wrong("blocked");
  if (job.is_over_budget != (stop_reason(job) != nullptr)) return wrong("over budget");
  return absl::OkStatus();
}

absl::Status Scheduler::verify_worker(const Worker& worker) const {
  const auto wrong = [&](const char* what) {
    return differs(absl::StrCat("worker ", worker.id, ": ", what));
  };
  const bool is_idle = worker.is_working() && worker.credits > 0;
  if (worker.is_counted != worker.is_working()) return wrong("working");
  if (worker.idle_load.has_value() != is_idle) return wrong("idle");
  if (is_idle && idle_.count({worker.load(), worker.key}) == 0) return wrong("load");
  if (worker.outbox.size() > policy_.max_outbox + 1) return wrong("outbox");
  for (const auto& [key, unit] : worker.leased_units) {
    const auto job = jobs_.find(key);
    if (job == jobs_.end()) return wrong("unit of a job that is gone");
    const auto audit = job->second.audits.find(unit);
    if (audit != job->second.audits.end() && audit->second.holder &&
        audit->second.holder->worker == worker.key) {
      continue;
    }
    if (job->second.holders.count(worker.key) == 0) return wrong("unit that it does not hold");
  }
  return absl::OkStatus();
}

absl::Status Scheduler::verify() const {
  std::size_t audits = 0;
  for (const auto& [key, job] : jobs_) {
    if (absl::Status status = verify_job(job); !status.ok()) return status;
    for (const auto& [unit, audit] : job.audits) audits += audit.group ? 1 : 0;
  }
  if (queue_.size() != queued_.size()) return differs("size of the queue");
  if (waiting_audits_.size() != audits) return differs("number of audits that wait");
  FarmCensus working, present;
  std::map<std::string, std::int32_t> idle_tags;
  std::size_t idle = 0;
  Names tags{""}, witnesses;
  for (const auto& [key, worker] : workers_) {
    if (absl::Status status = verify_worker(worker); !status.ok()) return status;
    if (worker.is_working()) working.add(worker);
    if (worker.is_available()) present.add(worker);
    witnesses.insert(worker.witness);
    tags.insert(worker.serves.begin(), worker.serves.end());
    if (!worker.idle_load) continue;
    ++idle;
    Names own = worker.serves;
    own.insert("");
    for (const std::string& tag : own) ++idle_tags[tag];
  }
  if (idle_.size() != idle || idle_tags_ != idle_tags) return differs("idle workers");
  for (const std::string& tag : tags) {
    std::string found = difference(working_, working, tag);
    if (found.empty()) found = difference(present_, present, tag);
    if (!found.empty()) return differs(absl::StrCat("count of tag \"", tag, "\": ", found));
  }
  if (absl::Status status = verify_limits(); !status.ok()) return status;
  if (workers_by_witness_.size() != witnesses.size()) return differs("witnesses");
  for (const auto& [witness, conduct] : conduct_) {
    if (witnesses.count(witness) == 0) return differs("conduct of a witness that is gone");
  }
  return absl::OkStatus();
}

}  // namespace tessera::server
