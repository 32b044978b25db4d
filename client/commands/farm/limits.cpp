#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/cli/table.h"
#include "client/commands/farm/farm_commands.h"

namespace tessera::client {
namespace {

struct LimitOptions {
  std::string name;
  std::int64_t units = 0;
};

int list_limits(bool json, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto limits = (*client)->list_limits();
  if (!limits.ok()) return fail(limits.status());
  if (json) {
    nlohmann::ordered_json document = {{"schema", "tessera.limits/1"},
                                       {"limits", nlohmann::ordered_json::array()}};
    for (const v1::Limit& limit : *limits) {
      document["limits"].push_back({{"name", limit.name()},
                                    {"units", limit.unit_count()},
                                    {"used", limit.used_unit_count()}});
    }
    std::printf("%s\n", document.dump(2).c_str());
    return kExitDone;
  }
  Table table({"LIMIT", "AMOUNT", "USED"});
  for (const v1::Limit& limit : *limits) {
    table.add({limit.name(), std::to_string(limit.unit_count()),
               std::to_string(limit.used_unit_count())});
  }
  std::fputs(table.text().c_str(), stdout);
  return kExitDone;
}

int set_limit(const LimitOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto limit = (*client)->set_limit(options.name, options.units);
  if (!limit.ok()) return fail(limit.status());
  std::printf("%s has %lld units, %lld in use\n", limit->name().c_str(),
              static_cast<long long>(limit->unit_count()),
              static_cast<long long>(limit->used_unit_count()));
  return kExitDone;
}

int remove_limit(const LimitOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  if (const absl::Status status = (*client)->remove_limit(options.name); !status.ok()) {
    return fail(status);
  }
  std::printf("%s removed\n", options.name.c_str());
  return kExitDone;
}

CLI::App* add_order(CLI::App& command, Invocation& invocation, const char* name, const char* text,
                    LimitOptions& options) {
  CLI::App* sub = cli::add_command(command, name, text);
  add_connection_options(*sub, invocation.connection);
  sub->add_option("name", options.name, "Name of the limit")->required();
  return sub;
}

}  // namespace

void add_limits_command(CLI::App& app, Invocation& invocation) {
  auto json = std::make_shared<bool>(false);
  CLI::App* command = cli::add_command(
      app, "limits", "List limits, such as licences, and how many units of each are in use");
  add_connection_options(*command, invocation.connection);
  command->add_flag("--json", *json, "Print JSON (tessera.limits/1)");
  auto to_set = std::make_shared<LimitOptions>();
  CLI::App* set = add_order(*command, invocation, "set",
                            "Create a limit, or change its number of units", *to_set);
  set->add_option("units", to_set->units, "Maximum number of units in use at once")
      ->required()
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{1'000'000}));
  set->footer("Example:\n  tessera limits set licence 8");
  set->callback([to_set, &invocation] {
    invocation.run = [to_set, &invocation] { return set_limit(*to_set, invocation.connection); };
  });
  auto to_remove = std::make_shared<LimitOptions>();
  CLI::App* remove =
      add_order(*command, invocation, "remove",
                "Remove a limit; jobs that name it no longer wait for it", *to_remove);
  remove->footer("Example:\n  tessera limits remove licence");
  remove->callback([to_remove, &invocation] {
    invocation.run = [to_remove, &invocation] {
      return remove_limit(*to_remove, invocation.connection);
    };
  });
  command->require_subcommand(0, 1);
  command->footer(
      "`submit --limit NAME` makes the units of a job count against a limit. On farms with "
      "certificates, set and remove require an admin certificate.\n"
      "Examples:\n  tessera limits\n  tessera limits set licence 8");
  command->callback([command, json, &invocation] {
    if (!command->get_subcommands().empty()) return;  // the subcommand has its own callback
    invocation.run = [json, &invocation] { return list_limits(*json, invocation.connection); };
  });
}

}  // namespace tessera::client
