#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Period after which the used amount is reset, in UTC; numbers as in v1.Budget.Period.
enum class BudgetPeriod : std::int32_t { ever = 1, day = 2, week = 3, month = 4 };

/// The effect of a budget that is used up; numbers as in v1.Budget.Action.
enum class BudgetAction : std::int32_t { warn = 1, stop = 2 };

/// CPU time that an account may use per period.
struct Budget {
  double cpu_seconds = 0;
  BudgetPeriod period = BudgetPeriod::ever;
  BudgetAction action = BudgetAction::stop;
  double warning_fraction = 0.8;
};

/// Level of a budget's use.
enum class BudgetLevel : std::int32_t { below = 0, warning = 1, used_up = 2 };

/// A budget and its use in the current period.
struct BudgetState {
  Budget budget;
  std::int64_t period_start_us = 0;  // wall clock; 0: of BudgetPeriod::ever
  double used_cpu_seconds = 0;
  BudgetLevel told = BudgetLevel::below;  // highest level in this period that events tell of

  BudgetLevel level() const;
};

/// Returns the start of the period that contains `now_us`, µs since 1970; 0 for BudgetPeriod::ever.
std::int64_t period_start_us(BudgetPeriod period, std::int64_t now_us);

/// Returns the account for users: "client ann".
std::string account_text(const Account& account);

/// Returns a text about the use of a budget, for users.
std::string budget_text(const Account& account, const BudgetState& state);

/// Budgets of accounts and their use. A period begins when its start has passed; a clock that is
/// set back does not begin a period again. Pure.
class BudgetLedger {
 public:
  using ByAccount = std::map<Account, BudgetState>;

  void set(const Account& account, const BudgetState& state) { budgets_[account] = state; }
  bool remove(const Account& account) { return budgets_.erase(account) > 0; }
  bool empty() const { return budgets_.empty(); }
  const ByAccount& all() const { return budgets_; }
  const BudgetState* find(const Account& account) const;

  /// Adds CPU time that a job of this owner and project has used.
  void charge(const std::string& owner, const std::string& project, double cpu_seconds);
  /// Begins the periods whose start has passed. Returns whether any did.
  bool advance(std::int64_t now_us);
  /// Returns whether take_untold() would return one of these accounts.
  bool has_untold(const std::string& owner, const std::string& project) const;
  /// Marks the accounts whose level has risen above what events tell of as told, and returns them.
  std::vector<Account> take_untold();
  /// Forgets that events tell of this account's level.
  void untell(const Account& account);
  /// Returns, for accounts that are leased nothing, the reason.
  std::map<Account, std::string> stop_reasons() const;

 private:
  ByAccount budgets_;
};

/// Writes and reads a budget as a value of SettingKind::budget, without its use.
std::string write_budget(const BudgetState& state);
std::optional<BudgetState> read_budget(const std::string& value);

}  // namespace tessera::server
