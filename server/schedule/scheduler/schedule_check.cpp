#include "server/schedule/scheduler/schedule_check.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace tessera::server {

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

absl::Status ScheduleCheck::verify() const {
  std::size_t audits = 0;
  for (const auto& [key, job] : jobs_.all()) {
    if (absl::Status status = verify_job(job); !status.ok()) return status;
    for (const auto& [unit, audit] : job.audits) audits += audit.group ? 1 : 0;
  }
  for (const JobKey key : audit_table_.audited_jobs()) {
    const Job* job = jobs_.find(key);
    if (job == nullptr || job->audits.empty()) return differs("audited jobs");
  }
  if (ready_.queue().size() != ready_.queued_count()) return differs("size of the queue");
  if (audit_table_.waiting().size() != audits) return differs("number of audits that wait");
  FarmCensus working, present;
  std::map<std::string, std::int32_t> idle_tags;
  std::size_t idle = 0;
  std::set<std::string> tags{""}, witnesses;
  for (const auto& [key, worker] : workers_.all()) {
    if (absl::Status status = verify_worker(worker); !status.ok()) return status;
    if (worker.is_working()) working.add(worker);
    if (worker.is_available()) present.add(worker);
    witnesses.insert(worker.witness);
    tags.insert(worker.serves.begin(), worker.serves.end());
    if (!worker.idle_load) continue;
    ++idle;
    std::set<std::string> own = worker.serves;
    own.insert("");
    for (const std::string& tag : own) ++idle_tags[tag];
  }
  if (counts_.idle().size() != idle || counts_.idle_tags() != idle_tags)
    return differs("idle workers");
  for (const std::string& tag : tags) {
    std::string found = difference(counts_.working(), working, tag);
    if (found.empty()) found = difference(counts_.present(), present, tag);
    if (!found.empty()) return differs(absl::StrCat("count of tag \"", tag, "\": ", found));
  }
  if (absl::Status status = verify_limits(); !status.ok()) return status;
  if (workers_.witness_count() != witnesses.size()) return differs("witnesses");
  for (const auto& [witness, conduct] : quarantine_.conduct()) {
    if (witnesses.count(witness) == 0) return differs("conduct of a witness that is gone");
  }
  return absl::OkStatus();
}

absl::Status ScheduleCheck::verify_job(const Job& job) const {
  const auto wrong = [&](const char* what) {
    return differs(absl::StrCat("job ", job.spec->id, ": ", what));
  };
  if (jobs_.of_state(job.state).count(job.key) == 0) return wrong("state");
  if (job.audits.empty() != (audit_table_.audited_jobs().count(job.key) == 0)) {
    return wrong("audited");
  }
  const bool is_runnable = job.is_runnable();
  if (ready_.is_queued(job.key) != (is_runnable && !ReadyJobs::has_all_workers(job)))
    return wrong("queued");
  if (ready_.full().count(job.key) != (is_runnable && ReadyJobs::has_all_workers(job) ? 1U : 0U))
    return wrong("full");
  std::map<WorkerKey, std::int32_t> holders;
  if (job.plan) {
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      for (const Holder& holder : in_flight.holders) {
        ++holders[holder.worker];
        const Worker* worker = workers_.find(holder.worker);
        if (worker == nullptr || !LeaseTable::holds(*worker, job, unit)) return wrong("a holder");
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
    const bool is_blocked = checks_.is_frame_blocked(job, frame);
    if (is_blocked != (job.blocked_frames.count(frame) > 0)) return wrong("blocked frames");
    if (job.plan && job.plan->is_held_back(frame) != is_blocked) return wrong("held back frames");
  }
  const bool is_blocked = std::any_of(
      job.spec->after.begin(), job.spec->after.end(),
      [this](const Dependency& each) { return checks_.state_of(each) != DependencyState::met; });
  if (is_blocked != job.is_blocked) return wrong("blocked");
  if (job.is_over_budget != (stopped_.reason_for(job) != nullptr)) return wrong("over budget");
  return absl::OkStatus();
}

absl::Status ScheduleCheck::verify_worker(const Worker& worker) const {
  const auto wrong = [&](const char* what) {
    return differs(absl::StrCat("worker ", worker.id, ": ", what));
  };
  const bool is_idle = worker.is_working() && worker.credits > 0;
  if (worker.is_counted != worker.is_working()) return wrong("working");
  if (worker.idle_load.has_value() != is_idle) return wrong("idle");
  if (is_idle && counts_.idle().count({worker.load(), worker.key}) == 0) return wrong("load");
  if (worker.outbox.size() > policy_.max_outbox + 1) return wrong("outbox");
  for (const auto& [key, unit] : worker.leased_units) {
    const Job* job = jobs_.find(key);
    if (job == nullptr) return wrong("unit of a job that is gone");
    const auto audit = job->audits.find(unit);
    if (audit != job->audits.end() && audit->second.holder &&
        audit->second.holder->worker == worker.key) {
      continue;
    }
    if (job->holders.count(worker.key) == 0) return wrong("unit that it does not hold");
  }
  return absl::OkStatus();
}

absl::Status ScheduleCheck::verify_limits() const {
  std::map<std::string, std::int64_t> used, queued;
  for (const auto& [key, job] : jobs_.all()) {
    std::int64_t leases = 0;
    for (const auto& [worker, units] : job.holders) leases += units;
    for (const auto& [unit, audit] : job.audits) leases += audit.holder ? 1 : 0;
    if (leases != job.lease_count) {
      return absl::InternalError(absl::StrCat("scheduler: leases of job ", job.spec->id));
    }
    for (const LimitUse& use : job.spec->limits) used[use.limit] += leases * use.units;
    if (!job.spec->limits.empty() && ready_.is_queued(key)) {
      ++queued[LimitedQueues::name(job.requirement, job.spec->limits)];
    }
  }
  for (const auto& [name, limit] : ready_.limited().limits().all()) {
    if (limit.used != used[name]) return absl::InternalError("scheduler: use of limit " + name);
    used.erase(name);
  }
  for (const auto& [name, units] : used) {
    if (units != 0) return absl::InternalError("scheduler: limit " + name + " is missing");
  }
  return ready_.limited().verify(queued);
}

}  // namespace tessera::server
