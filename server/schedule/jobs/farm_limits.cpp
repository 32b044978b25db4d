#include "server/schedule/jobs/farm_limits.h"

#include <utility>

namespace tessera::server {

namespace {

/// Calls `visit` with the job and the holder of each lease that is charged to its owner. Starts
/// from the workers, because most jobs may have no leases.
template <typename Visit>
void for_each_charged(const WorkerTable& workers, const JobTable& jobs, const Visit& visit) {
  for (const auto& [key, worker] : workers.all()) {
    for (const auto& [job_key, unit] : worker.leased_units) {
      const Job& job = jobs.at(job_key);
      const auto in_flight = job.plan->in_flight().find(unit);
      if (in_flight == job.plan->in_flight().end()) continue;  // an audit
      for (const Holder& holder : in_flight->second.holders) {
        if (holder.worker == key) visit(job, holder);
      }
    }
  }
}

}  // namespace

FairShare FarmLimits::committed_share() const {
  FairShare committed = share();
  for_each_charged(workers_, jobs_, [&](const Job& job, const Holder& holder) {
    committed.charge(job.spec->owner, -holder.expected_seconds, holder.charged);
  });
  return committed;
}

void FarmLimits::set_weight(const std::string& owner, double weight, Time now) {
  ready_.advance(now);
  // Leases are charged again with the new weight, with which they will be taken back.
  const auto charge_leases = [&](double sign) {
    for_each_charged(workers_, jobs_, [&](const Job& job, const Holder& holder) {
      if (job.spec->owner != owner) return;
      ready_.queue().charge(owner, sign * holder.expected_seconds, holder.charged);
    });
  };
  charge_leases(-1);
  ready_.queue().set_weight(owner, weight);
  charge_leases(1);
}

void FarmLimits::set_limit(const std::string& name, std::int64_t units, Time now) {
  ready_.advance(now);
  ready_.limited().limits().set(name, units);
  ready_.note_work();
  dispatcher_.dispatch_all(now);
}

bool FarmLimits::remove_limit(const std::string& name, Time now) {
  ready_.advance(now);
  const bool existed = ready_.limited().limits().remove(name);
  ready_.note_work();
  dispatcher_.dispatch_all(now);
  return existed;
}

void FarmLimits::stop_accounts(StoppedAccounts::Reasons reasons, Time now) {
  ready_.advance(now);
  if (!stopped_.set(std::move(reasons))) return;
  jobs_.for_each([this](Job& job) {
    const bool is_over_budget = stopped_.reason_for(job) != nullptr;
    if (is_over_budget == job.is_over_budget) return;
    job.is_over_budget = is_over_budget;
    ready_.refresh(job);
  });
  dispatcher_.dispatch_all(now);
}

}  // namespace tessera::server
