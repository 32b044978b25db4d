#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/schedule/leasing/dispatcher.h"
#include "server/schedule/queue/fair_share.h"
#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Limits of the whole farm: named limits, stopped accounts, weights and past use for fair share.
class FarmLimits {
 public:
  FarmLimits(Tables& tables, Dispatcher& dispatcher)
      : workers_(tables.workers),
        jobs_(tables.jobs),
        stopped_(tables.stopped),
        ready_(tables.ready),
        dispatcher_(dispatcher) {}

  /// Units of named limits, and how many are in use.
  const Limits& table() const { return ready_.limited().limits(); }
  void set_limit(const std::string& name, std::int64_t units, Time now);
  /// Returns whether the limit existed.
  bool remove_limit(const std::string& name, Time now);
  /// Stops leasing units of jobs of these accounts, and only of these, for these reasons. Audits
  /// continue.
  void stop_accounts(StoppedAccounts::Reasons reasons, Time now);
  /// Changes an owner's weight in fair share. It counts for units leased from now on and for those
  /// in flight. Requires a positive weight.
  void set_weight(const std::string& owner, double weight, Time now);
  /// Weights and use of owners, with units in flight.
  const FairShare& share() const { return ready_.queue().share(); }
  /// The same without units in flight.
  FairShare committed_share() const;
  void restore_usage(const std::vector<UsageRow>& table, Time now) {
    ready_.queue().restore(table, now);
  }
  /// Returns the decayed use of every owner, without units in flight, for restore_usage() after a
  /// restart; units in flight are charged again when their workers return.
  std::vector<UsageRow> usage(Time now) const { return committed_share().table(now); }

 private:
  const WorkerTable& workers_;
  JobTable& jobs_;
  StoppedAccounts& stopped_;
  ReadyJobs& ready_;
  Dispatcher& dispatcher_;
};

}  // namespace tessera::server
