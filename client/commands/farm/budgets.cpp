#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "cli/finite_range.h"
#include "client/api/farm_client.h"
#include "client/cli/table.h"
#include "client/commands/farm/farm_commands.h"

namespace tessera::client {
namespace {

constexpr double kHour = 3600;

constexpr std::pair<const char*, v1::Budget::Period> kPeriods[] = {
    {"ever", v1::Budget::PERIOD_EVER},
    {"day", v1::Budget::PERIOD_DAY},
    {"week", v1::Budget::PERIOD_WEEK},
    {"month", v1::Budget::PERIOD_MONTH}};
constexpr std::pair<const char*, v1::Budget::Action> kActions[] = {
    {"warn", v1::Budget::ACTION_WARN}, {"stop", v1::Budget::ACTION_STOP}};

template <typename Names, typename Value>
std::string name_of(const Names& names, Value value) {
  for (const auto& [name, named] : names) {
    if (named == value) return name;
  }
  return "unknown";
}

/// Returns the value of a name that the command line has checked.
template <typename Names>
auto value_of(const Names& names, const std::string& text) {
  const auto found = std::find_if(std::begin(names), std::end(names),
                                  [&](const auto& entry) { return entry.first == text; });
  return found->second;
}

struct BudgetOptions {
  std::string owner, project;
  // Only `budgets set` has these options. One that is not given keeps the budget's value.
  std::optional<std::string> period, action;
  std::optional<double> cpu_hours, warning_fraction;

  v1::Budget::Scope scope() const {
    return owner.empty() ? v1::Budget::SCOPE_PROJECT : v1::Budget::SCOPE_OWNER;
  }
  const std::string& name() const { return owner.empty() ? project : owner; }
};

std::string account_of(const v1::Budget& budget) {
  return absl::StrCat(budget.scope() == v1::Budget::SCOPE_OWNER ? "client " : "project ",
                      budget.name());
}

nlohmann::ordered_json document_of(const v1::Budget& budget) {
  return {{"scope", budget.scope() == v1::Budget::SCOPE_OWNER ? "owner" : "project"},
          {"name", budget.name()},
          {"cpu_seconds", budget.cpu_seconds()},
          {"used_cpu_seconds", budget.used_cpu_seconds()},
          {"period", name_of(kPeriods, budget.period())},
          {"action", name_of(kActions, budget.action())},
          {"warning_fraction", budget.warning_fraction()}};
}

int run_list(bool json, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto budgets = (*client)->list_budgets();
  if (!budgets.ok()) return fail(budgets.status());
  if (json) {
    nlohmann::ordered_json document = {{"schema", "tessera.budgets/1"},
                                       {"budgets", nlohmann::ordered_json::array()}};
    for (const v1::Budget& budget : *budgets) document["budgets"].push_back(document_of(budget));
    std::printf("%s\n", document.dump(2).c_str());
    return kExitDone;
  }
  Table table({"ACCOUNT", "CPU HOURS", "USED", "PERIOD", "WARN AT", "WHEN USED UP"});
  for (const v1::Budget& budget : *budgets) {
    table.add({account_of(budget), absl::StrFormat("%.6g", budget.cpu_seconds() / kHour),
               format_share(budget.used_cpu_seconds(), budget.cpu_seconds()),
               name_of(kPeriods, budget.period()),
               absl::StrFormat("%.4g", budget.warning_fraction()),
               name_of(kActions, budget.action())});
  }
  std::fputs(table.text().c_str(), stdout);
  return kExitDone;
}

/// Returns the account's budget, or one with the defaults and no CPU time if it has none.
absl::StatusOr<v1::Budget> current_budget(FarmClient& client, const BudgetOptions& options) {
  const auto budgets = client.list_budgets();
  if (!budgets.ok()) return budgets.status();
  for (const v1::Budget& budget : *budgets) {
    if (budget.scope() == options.scope() && budget.name() == options.name()) return budget;
  }
  v1::Budget budget;
  budget.set_scope(options.scope());
  budget.set_name(options.name());
  budget.set_period(v1::Budget::PERIOD_EVER);
  budget.set_action(v1::Budget::ACTION_STOP);
  budget.set_warning_fraction(0.8);
  return budget;
}

int run_set(const BudgetOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  auto budget = current_budget(**client, options);
  if (!budget.ok()) return fail(budget.status());
  if (options.cpu_hours) budget->set_cpu_seconds(*options.cpu_hours * kHour);
  if (options.period) budget->set_period(value_of(kPeriods, *options.period));
  if (options.action) budget->set_action(value_of(kActions, *options.action));
  if (options.warning_fraction) budget->set_warning_fraction(*options.warning_fraction);
  if (budget->cpu_seconds() == 0) {
    return fail(absl::InvalidArgumentError(
        absl::StrCat(account_of(*budget), " has no budget yet: give --cpu-hours")));
  }
  const auto set = (*client)->set_budget(*budget);
  if (!set.ok()) return fail(set.status());
  std::printf("%s: %.6g CPU hours, %s used; period: %s, warn at %.4g, when used up: %s\n",
              account_of(*set).c_str(), set->cpu_seconds() / kHour,
              format_share(set->used_cpu_seconds(), set->cpu_seconds()).c_str(),
              name_of(kPeriods, set->period()).c_str(), set->warning_fraction(),
              name_of(kActions, set->action()).c_str());
  return kExitDone;
}

int run_remove(const BudgetOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const absl::Status status = (*client)->remove_budget(options.scope(), options.name());
  if (!status.ok()) return fail(status);
  std::printf("the budget of %s %s is removed\n", options.owner.empty() ? "project" : "client",
              options.name().c_str());
  return kExitDone;
}

CLI::App* add_command(CLI::App& command, Invocation& invocation, const char* name,
                      const char* description, const std::shared_ptr<BudgetOptions>& options,
                      int (*run)(const BudgetOptions&, const Connection&)) {
  CLI::App* sub = cli::add_command(command, name, description);
  add_connection_options(*sub, invocation.connection);
  CLI::Option_group* account = sub->add_option_group("Account", "");
  account->add_option("--owner", options->owner, "Client whose jobs count")->type_name("NAME");
  account->add_option("--project", options->project, "Project whose jobs count")->type_name("NAME");
  account->require_option(1);
  sub->callback([options, run, &invocation] {
    invocation.run = [options, run, &invocation] { return run(*options, invocation.connection); };
  });
  return sub;
}

void add_set_options(CLI::App& command, BudgetOptions& options) {
  command.add_option("--cpu-hours", options.cpu_hours, "CPU hours per period (required if new)")
      ->check(cli::finite_range(1e-6, 1e11))
      ->type_name("HOURS");
  command.add_option("--period", options.period, "Period of the budget, in UTC (new: ever)")
      ->check(CLI::IsMember({"ever", "day", "week", "month"}));
  command
      .add_option(
          "--when-used-up", options.action,
          "Action when the budget is used up: only warn, or stop leasing units; leased units "
          "are finished (new: stop)")
      ->check(CLI::IsMember({"warn", "stop"}));
  command
      .add_option("--warn-at", options.warning_fraction,
                  "Used fraction of the budget at which to warn (new: 0.8)")
      ->check(cli::finite_range(0.01, 1.0));
}

}  // namespace

void add_budgets_command(CLI::App& app, Invocation& invocation) {
  auto json = std::make_shared<bool>(false);
  CLI::App* command =
      cli::add_command(app, "budgets", "List the budgets of clients and projects and their use");
  add_connection_options(*command, invocation.connection);
  command->add_flag("--json", *json, "Print JSON (tessera.budgets/1)");
  const auto to_set = std::make_shared<BudgetOptions>();
  CLI::App* set = add_command(*command, invocation, "set", "Set the budget of a client or project",
                              to_set, run_set);
  add_set_options(*set, *to_set);
  set->footer(
      "Options that are not given keep their values, or have the defaults of a new budget.\n"
      "CPU time used earlier in the period counts as well. Events report when the fraction\n"
      "--warn-at is used, and when the whole budget is used up.\n"
      "Examples:\n  tessera budgets set --owner ann --cpu-hours 500 --period month\n"
      "  tessera budgets set --project film --cpu-hours 20000 --when-used-up warn\n"
      "  tessera budgets set --owner ann --cpu-hours 800");
  add_command(*command, invocation, "remove", "Remove a budget", std::make_shared<BudgetOptions>(),
              run_remove)
      ->footer("Example:\n  tessera budgets remove --owner ann");
  command->require_subcommand(0, 1);
  command->footer(
      "On farms with certificates, set and remove require an admin certificate, and a client sees\n"
      "only its own budget.\n"
      "Examples:\n  tessera budgets\n  tessera budgets set --owner ann --cpu-hours 500");
  command->callback([command, json, &invocation] {
    if (!command->get_subcommands().empty()) return;  // the subcommand has its own callback
    invocation.run = [json, &invocation] { return run_list(*json, invocation.connection); };
  });
}

}  // namespace tessera::client
