#include "server/settings/budgets.h"

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

/// Names of the rows: "1 ann", by the scope's number.
std::string row_name(const Account& account) {
  return absl::StrCat(static_cast<int>(account.scope), " ", account.name);
}

Settings rows_of(const BudgetLedger& ledger) {
  Settings rows;
  for (const auto& [account, state] : ledger.all()) rows[row_name(account)] = write_budget(state);
  return rows;
}

UsageQuery query_of(const Account& account, const BudgetState& state) {
  UsageQuery query;
  query.first_hour = state.period_start_us / kHourUs;
  if (account.scope == AccountScope::owner) {
    query.owner = account.name;
  } else {
    query.project = account.name;
  }
  return query;
}

}  // namespace

absl::StatusOr<double> Budgets::used(const Account& account, const BudgetState& state) const {
  return store_.usage().cpu_seconds(query_of(account, state));
}

absl::Status Budgets::load(FarmChange& change) {
  const auto rows = store_.settings().read(SettingKind::budget);
  if (!rows.ok()) return rows.status();
  for (const auto& [name, value] : *rows) {
    auto state = read_budget(value);
    if (!state || name.size() < 3) continue;
    const Account account{static_cast<AccountScope>(name[0] - '0'), name.substr(2)};
    BudgetLedger begun;
    begun.set(account, *state);
    begun.advance(farm_.options().wall_us());
    *state = *begun.find(account);
    const auto sum = used(account, *state);
    if (!sum.ok()) return sum.status();
    state->used_cpu_seconds = *sum;
    ledger_.set(account, *state);
  }
  enforce(change);
  return absl::OkStatus();
}

/// Tells of levels that have risen, once each, and stops the accounts whose budget is used up.
void Budgets::enforce(FarmChange& change) {
  for (const Account& account : ledger_.take_untold()) {
    const BudgetState& state = *ledger_.find(account);
    change.log(LogLevel::warn, budget_text(account, state));
    tell(account, state, account.scope == AccountScope::owner ? account.name : "");
  }
  change.scheduler().limits().stop_accounts(ledger_.stop_reasons(), change.now());
}

/// Writes the event together with the fact that it was told.
void Budgets::tell(const Account& account, const BudgetState& state, const std::string& owner) {
  const EventKind kind =
      state.level() == BudgetLevel::used_up ? EventKind::budget_used_up : EventKind::budget_warning;
  const Event event{0, 0, kind, "", owner, "", budget_text(account, state)};
  pipeline_.post_write(
      [this, rows = rows_of(ledger_), event] {
        absl::Status status = store_.settings().save(SettingKind::budget, rows);
        if (status.ok()) pipeline_.tell(event);
        return status;
      },
      [this, account](const absl::Status& status) {
        if (status.ok()) return;
        const FarmChange change(farm_);
        ledger_.untell(account);  // the next charge tries again
      });
}

void Budgets::set(const Account& account, const Budget& budget,
                  std::function<void(absl::StatusOr<Entry>)> done) {
  pipeline_.post(
      [this, account, budget, done = std::move(done)] { done(set_now(account, budget)); });
}

/// On the writer thread, which commits nothing meanwhile: what is used follows from the accounts.
absl::StatusOr<Budgets::Entry> Budgets::set_now(const Account& account, const Budget& budget) {
  BudgetState state{budget, period_start_us(budget.period, farm_.options().wall_us()), 0, {}};
  const auto sum = used(account, state);
  if (!sum.ok()) return sum.status();
  state.used_cpu_seconds = *sum;
  Settings rows;
  {
    const FarmView view(farm_);
    rows = rows_of(ledger_);
  }
  rows[row_name(account)] = write_budget(state);
  if (rows.size() > kMaxBudgets) {
    return absl::ResourceExhaustedError(
        absl::StrCat("there are ", kMaxBudgets, " budgets already"));
  }
  if (absl::Status saved = store_.settings().save(SettingKind::budget, rows); !saved.ok()) {
    return saved;
  }
  FarmChange change(farm_);
  ledger_.set(account, state);
  change.log(LogLevel::info, budget_text(account, state));
  enforce(change);
  return Entry{account, state};
}

void Budgets::remove(const Account& account, std::function<void(absl::Status)> done) {
  pipeline_.post([this, account, done = std::move(done)] { done(remove_now(account)); });
}

absl::Status Budgets::remove_now(const Account& account) {
  Settings rows;
  {
    const FarmView view(farm_);
    rows = rows_of(ledger_);
  }
  if (rows.erase(row_name(account)) == 0) {
    return absl::NotFoundError(absl::StrCat("no budget of ", account_text(account)));
  }
  if (absl::Status saved = store_.settings().save(SettingKind::budget, rows); !saved.ok()) {
    return saved;
  }
  FarmChange change(farm_);
  ledger_.remove(account);
  change.log(LogLevel::info, absl::StrCat("budget of ", account_text(account), " is removed"));
  enforce(change);
  return absl::OkStatus();
}

std::vector<Budgets::Entry> Budgets::list(const std::string& owner) const {
  const FarmView view(farm_);
  if (owner.empty()) return {ledger_.all().begin(), ledger_.all().end()};
  const Account account{AccountScope::owner, owner};
  const BudgetState* state = ledger_.find(account);
  return state == nullptr ? std::vector<Entry>{} : std::vector<Entry>{{account, *state}};
}

void Budgets::charge(FarmChange& change, const Job& job, double cpu_seconds) {
  if (ledger_.empty()) return;
  ledger_.charge(job.spec->owner, job.spec->project, cpu_seconds);
  if (ledger_.has_untold(job.spec->owner, job.spec->project)) enforce(change);
}

void Budgets::recount(const JobSpec& spec) {
  const Account accounts[] = {{AccountScope::owner, spec.owner},
                              {AccountScope::project, spec.project}};
  for (const Account& account : accounts) {
    BudgetState state;
    {
      const FarmView view(farm_);
      const BudgetState* found = ledger_.find(account);
      if (found == nullptr) continue;
      state = *found;
    }
    const auto sum = used(account, state);
    if (!sum.ok()) {
      farm_.log(LogLevel::error, absl::StrCat("budgets: ", sum.status().ToString()));
      continue;
    }
    FarmChange change(farm_);
    state.used_cpu_seconds = *sum;
    ledger_.set(account, state);
    enforce(change);
  }
}

void Budgets::tick(FarmChange& change) {
  const std::int64_t now_us = farm_.options().wall_us();
  if (now_us / kHourUs == last_hour_) return;  // periods start at full hours
  last_hour_ = now_us / kHourUs;
  if (ledger_.advance(now_us)) enforce(change);
}

}  // namespace tessera::server
