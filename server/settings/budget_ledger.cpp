#include "server/settings/budget_ledger.h"

#include <algorithm>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/time/civil_time.h"
#include "absl/time/time.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kDayUs = std::int64_t{24} * 3600 * 1'000'000;
constexpr std::int64_t kThursday = 3;  // days of 1970-01-01 after Monday

std::int64_t floor_to(std::int64_t value, std::int64_t step) {
  const std::int64_t rest = value % step;
  return value - (rest < 0 ? rest + step : rest);
}

const char* period_name(BudgetPeriod period) {
  switch (period) {
    case BudgetPeriod::day:
      return "today";
    case BudgetPeriod::week:
      return "this week";
    case BudgetPeriod::month:
      return "this month";
    case BudgetPeriod::ever:
      break;
  }
  return "in all";
}

std::string hours(double cpu_seconds) {
  return absl::StrFormat("%.6g", cpu_seconds / 3600);
}

}  // namespace

BudgetLevel BudgetState::level() const {
  if (used_cpu_seconds >= budget.cpu_seconds) return BudgetLevel::used_up;
  return used_cpu_seconds >= budget.warning_fraction * budget.cpu_seconds ? BudgetLevel::warning
                                                                          : BudgetLevel::below;
}

std::int64_t period_start_us(BudgetPeriod period, std::int64_t now_us) {
  switch (period) {
    case BudgetPeriod::day:
      return floor_to(now_us, kDayUs);
    case BudgetPeriod::week:
      return floor_to(now_us + kThursday * kDayUs, 7 * kDayUs) - kThursday * kDayUs;
    case BudgetPeriod::month: {
      const absl::CivilMonth month(absl::UTCTimeZone().At(absl::FromUnixMicros(now_us)).cs);
      return absl::ToUnixMicros(absl::UTCTimeZone().At(absl::CivilSecond(month)).pre);
    }
    case BudgetPeriod::ever:
      break;
  }
  return 0;
}

std::string account_text(const Account& account) {
  return absl::StrCat(account.scope == AccountScope::owner ? "client " : "project ", account.name);
}

std::string budget_text(const Account& account, const BudgetState& state) {
  return absl::StrCat("budget of ", account_text(account), ": ", hours(state.used_cpu_seconds),
                      " of ", hours(state.budget.cpu_seconds), " CPU hours are used ",
                      period_name(state.budget.period));
}

const BudgetState* BudgetLedger::find(const Account& account) const {
  const auto found = budgets_.find(account);
  return found == budgets_.end() ? nullptr : &found->second;
}

void BudgetLedger::charge(const std::string& owner, const std::string& project,
                          double cpu_seconds) {
  const auto add = [&](const Account& account) {
    const auto found = budgets_.find(account);
    if (found != budgets_.end()) found->second.used_cpu_seconds += cpu_seconds;
  };
  add({AccountScope::owner, owner});
  if (!project.empty()) add({AccountScope::project, project});
}

bool BudgetLedger::advance(std::int64_t now_us) {
  bool has_begun = false;
  for (auto& [account, state] : budgets_) {
    const std::int64_t start = period_start_us(state.budget.period, now_us);
    if (start <= state.period_start_us) continue;
    state.period_start_us = start;
    state.used_cpu_seconds = 0;
    state.told = BudgetLevel::below;
    has_begun = true;
  }
  return has_begun;
}

bool BudgetLedger::has_untold(const std::string& owner, const std::string& project) const {
  for (const Account& account :
       {Account{AccountScope::owner, owner}, Account{AccountScope::project, project}}) {
    const BudgetState* state = find(account);
    if (state != nullptr && state->level() > state->told) return true;
  }
  return false;
}

std::vector<Account> BudgetLedger::take_untold() {
  std::vector<Account> accounts;
  for (auto& [account, state] : budgets_) {
    if (state.level() <= state.told) continue;
    state.told = state.level();
    accounts.push_back(account);
  }
  return accounts;
}

void BudgetLedger::untell(const Account& account) {
  const auto found = budgets_.find(account);
  if (found != budgets_.end()) found->second.told = BudgetLevel::below;
}

std::map<Account, std::string> BudgetLedger::stop_reasons() const {
  std::map<Account, std::string> reasons;
  for (const auto& [account, state] : budgets_) {
    if (state.budget.action != BudgetAction::stop || state.level() != BudgetLevel::used_up)
      continue;
    reasons[account] = absl::StrCat(budget_text(account, state),
                                    "; an operator raises it with `tessera budgets set`");
  }
  return reasons;
}

std::string write_budget(const BudgetState& state) {
  return absl::StrFormat("%.17g %d %d %.17g %d %d", state.budget.cpu_seconds,
                         static_cast<int>(state.budget.period),
                         static_cast<int>(state.budget.action), state.budget.warning_fraction,
                         state.period_start_us, static_cast<int>(state.told));
}

std::optional<BudgetState> read_budget(const std::string& value) {
  const std::vector<std::string> parts = absl::StrSplit(value, ' ');
  BudgetState state;
  int period = 0, action = 0, told = 0;
  if (parts.size() != 6 || !absl::SimpleAtod(parts[0], &state.budget.cpu_seconds) ||
      !absl::SimpleAtoi(parts[1], &period) || !absl::SimpleAtoi(parts[2], &action) ||
      !absl::SimpleAtod(parts[3], &state.budget.warning_fraction) ||
      !absl::SimpleAtoi(parts[4], &state.period_start_us) || !absl::SimpleAtoi(parts[5], &told)) {
    return std::nullopt;
  }
  state.budget.period = static_cast<BudgetPeriod>(period);
  state.budget.action = static_cast<BudgetAction>(action);
  state.told = static_cast<BudgetLevel>(told);
  return state;
}

}  // namespace tessera::server
