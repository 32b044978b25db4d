#include "server/service/messages/account_messages.h"

#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/schedule/queue/fair_share.h"
#include "server/service/messages/field_checks.h"

namespace tessera::server {

absl::StatusOr<Account> to_account(v1::Budget::Scope scope, const std::string& name) {
  absl::Status status = check_name("name", name);
  if (scope != v1::Budget::SCOPE_OWNER && scope != v1::Budget::SCOPE_PROJECT) {
    status = bad("scope", absl::StrCat(static_cast<int>(scope), " is unknown"));
  }
  if (!status.ok()) return status;
  return Account{static_cast<AccountScope>(scope), name};
}

absl::StatusOr<Budget> from_message(const v1::Budget& message) {
  constexpr double kMaxCpuSeconds = 1e15, kMinFraction = 0.01;
  if (!(message.cpu_seconds() > 0 && message.cpu_seconds() <= kMaxCpuSeconds)) {
    return bad("cpu_seconds", absl::StrCat(message.cpu_seconds(), " is not in (0, 1e15]"));
  }
  if (message.period() < v1::Budget::PERIOD_EVER || message.period() > v1::Budget::PERIOD_MONTH) {
    return bad("period", absl::StrCat(static_cast<int>(message.period()), " is unknown"));
  }
  if (message.action() < v1::Budget::ACTION_WARN || message.action() > v1::Budget::ACTION_STOP) {
    return bad("action", absl::StrCat(static_cast<int>(message.action()), " is unknown"));
  }
  if (!(message.warning_fraction() >= kMinFraction && message.warning_fraction() <= 1)) {
    return bad("warning_fraction",
               absl::StrCat(message.warning_fraction(), " is not in [0.01, 1]"));
  }
  return Budget{message.cpu_seconds(), static_cast<BudgetPeriod>(message.period()),
                static_cast<BudgetAction>(message.action()), message.warning_fraction()};
}

absl::Status check_weight(double weight) {
  if (weight >= kMinWeight && weight <= kMaxWeight) return absl::OkStatus();
  return bad("weight", absl::StrCat(weight, " is not in [", kMinWeight, ", ", kMaxWeight, "]"));
}

v1::Budget to_message(const Account& account, const BudgetState& state) {
  v1::Budget message;
  message.set_scope(static_cast<v1::Budget::Scope>(account.scope));
  message.set_name(account.name);
  message.set_cpu_seconds(state.budget.cpu_seconds);
  message.set_period(static_cast<v1::Budget::Period>(state.budget.period));
  message.set_action(static_cast<v1::Budget::Action>(state.budget.action));
  message.set_warning_fraction(state.budget.warning_fraction);
  message.set_used_cpu_seconds(state.used_cpu_seconds);
  if (state.budget.period != BudgetPeriod::ever) {
    set_time(state.period_start_us, *message.mutable_period_start_time());
  }
  return message;
}

v1::Usage to_message(const UsageSum& sum) {
  v1::Usage message;
  message.set_owner(sum.owner);
  message.set_project(sum.project);
  message.set_job_id(sum.job_id);
  message.set_job_name(sum.job_name);
  message.set_unit_count(sum.units);
  message.set_cpu_seconds(sum.cpu_seconds);
  return message;
}

absl::StatusOr<UsageQuery> from_message(const v1::ListUsageRequest& message) {
  UsageQuery query;
  for (const int group : message.group_by()) {
    query.by_owner = query.by_owner || group == v1::ListUsageRequest::GROUP_OWNER;
    query.by_project = query.by_project || group == v1::ListUsageRequest::GROUP_PROJECT;
    query.by_job = query.by_job || group == v1::ListUsageRequest::GROUP_JOB;
  }
  constexpr std::int64_t kHour = kHourUs / 1'000'000;
  if (message.has_start_time()) query.first_hour = message.start_time().seconds() / kHour;
  if (message.has_end_time()) {
    query.end_hour = (message.end_time().seconds() + kHour - 1) / kHour;
  }
  if (!message.owner().empty()) query.owner = message.owner();
  if (message.has_project()) query.project = message.project();
  if (message.page_token().empty()) return query;
  const std::vector<std::string> parts = absl::StrSplit(message.page_token(), '\n');
  UsageSum after;
  if (parts.size() != 3 || !absl::SimpleAtoi(parts[2], &after.job)) {
    return bad("page_token", "not a token of this server");
  }
  after.owner = parts[0];
  after.project = parts[1];
  query.after = after;
  return query;
}

std::string page_token_after(const UsageSum& sum) {
  return absl::StrCat(sum.owner, "\n", sum.project, "\n", sum.job);
}

}  // namespace tessera::server
