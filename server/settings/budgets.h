#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/commit/commit_pipeline.h"
#include "server/settings/budget_ledger.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Budgets of clients and projects: compares them with the accounts of the store, publishes events
/// about those that run short, and has the scheduler stop jobs whose budget is used up.
/// Thread-safe.
class Budgets {
 public:
  static constexpr std::size_t kMaxBudgets = 10'000;

  Budgets(FarmState& farm, Store& store, CommitPipeline& pipeline)
      : farm_(farm), store_(store), pipeline_(pipeline) {}

  /// Reads budgets and accounts of the store, before any thread runs. Errors: those of the store.
  absl::Status load(FarmChange& change);

  using Entry = std::pair<Account, BudgetState>;
  /// Sets a budget durably, then calls `done`. Errors: ResourceExhausted, there are kMaxBudgets
  /// others; those of the store.
  void set(const Account& account, const Budget& budget,
           std::function<void(absl::StatusOr<Entry>)> done);
  /// Removes a budget durably, then calls `done`. Errors: NotFound; those of the store.
  void remove(const Account& account, std::function<void(absl::Status)> done);
  /// Returns the budgets by account; with an owner only that owner's.
  std::vector<Entry> list(const std::string& owner) const;

  /// A unit of the job is durable.
  void charge(FarmChange& change, const Job& job, double cpu_seconds);
  /// Reads the accounts of the job's owner and project again, after charges were taken back. On the
  /// writer thread.
  void recount(const JobSpec& spec);
  /// Begins new periods. Call at each tick.
  void tick(FarmChange& change);

 private:
  absl::StatusOr<Entry> set_now(const Account& account, const Budget& budget);
  absl::Status remove_now(const Account& account);
  absl::StatusOr<double> used(const Account& account, const BudgetState& state) const;
  void enforce(FarmChange& change);
  void tell(const Account& account, const BudgetState& state, const std::string& owner);

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  // Guarded by the farm's lock.
  BudgetLedger ledger_;
  std::int64_t last_hour_ = 0;  // in which tick() looked
};

}  // namespace tessera::server
