#include "server/schedule/jobs/farm_limits.h"

#include <utility>

namespace tessera::server {

std::vector<UsageRow> FarmLimits::usage(Time now) const {
  FairShare committed = ready_.queue().share();
  for (const auto& [key, job] : jobs_.all()) {
    if (!job.plan) continue;
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      for (const Holder& holder : in_flight.holders) {
        committed.charge(job.spec->owner, -holder.expected_seconds, holder.charged);
      }
    }
  }
  return committed.table(now);
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
  stopped_.set(std::move(reasons));
  jobs_.for_each([this](Job& job) {
    const bool is_over_budget = stopped_.reason_for(job) != nullptr;
    if (is_over_budget == job.is_over_budget) return;
    job.is_over_budget = is_over_budget;
    ready_.refresh(job);
  });
  dispatcher_.dispatch_all(now);
}

}  // namespace tessera::server
