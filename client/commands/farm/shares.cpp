#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "cli/finite_range.h"
#include "client/api/farm_client.h"
#include "client/cli/table.h"
#include "client/commands/farm/farm_commands.h"

namespace tessera::client {
namespace {

struct ShareOptions {
  std::string client;
  double weight = 1;
};

/// Name of a source in JSON documents.
const char* name_of(v1::ClientShare::Source source) {
  switch (source) {
    case v1::ClientShare::SOURCE_DEFAULT:
      return "default";
    case v1::ClientShare::SOURCE_OPTION:
      return "option";
    case v1::ClientShare::SOURCE_SET:
      return "set";
    default:
      return "unknown";
  }
}

/// Explanation of a source in tables and messages.
const char* text_of(v1::ClientShare::Source source) {
  switch (source) {
    case v1::ClientShare::SOURCE_DEFAULT:
      return "default";
    case v1::ClientShare::SOURCE_OPTION:
      return "server option";
    case v1::ClientShare::SOURCE_SET:
      return "set by operator";
    default:
      return "unknown";
  }
}

std::string weight_text(double weight) {
  return absl::StrFormat("%.6g", weight);
}

int list_shares(bool json, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto shares = (*client)->list_shares();
  if (!shares.ok()) return fail(shares.status());
  if (json) {
    nlohmann::ordered_json document = {{"schema", "tessera.shares/1"},
                                       {"shares", nlohmann::ordered_json::array()}};
    for (const v1::ClientShare& share : *shares) {
      document["shares"].push_back({{"client", share.client()},
                                    {"weight", share.weight()},
                                    {"source", name_of(share.source())},
                                    {"usage_cpu_seconds", share.usage_cpu_seconds()}});
    }
    std::printf("%s\n", document.dump(2).c_str());
    return kExitDone;
  }
  Table table({"CLIENT", "WEIGHT", "SOURCE", "USAGE"});
  for (const v1::ClientShare& share : *shares) {
    table.add({share.client(), weight_text(share.weight()), text_of(share.source()),
               absl::StrFormat("%.1f s", share.usage_cpu_seconds())});
  }
  std::fputs(table.text().c_str(), stdout);
  return kExitDone;
}

int print_share(const absl::StatusOr<v1::ClientShare>& share) {
  if (!share.ok()) return fail(share.status());
  std::printf("%s has weight %s (%s)\n", share->client().c_str(),
              weight_text(share->weight()).c_str(), text_of(share->source()));
  return kExitDone;
}

int set_share(const ShareOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  return print_share((*client)->set_share(options.client, options.weight));
}

int reset_share(const ShareOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  return print_share((*client)->reset_share(options.client));
}

CLI::App* add_order(CLI::App& command, Invocation& invocation, const char* name, const char* text,
                    const std::shared_ptr<ShareOptions>& options,
                    int (*run)(const ShareOptions&, const Connection&)) {
  CLI::App* sub = cli::add_command(command, name, text);
  add_connection_options(*sub, invocation.connection);
  sub->add_option("client", options->client, "Name of the client")->required();
  sub->callback([options, run, &invocation] {
    invocation.run = [options, run, &invocation] { return run(*options, invocation.connection); };
  });
  return sub;
}

}  // namespace

void add_shares_command(CLI::App& app, Invocation& invocation) {
  auto json = std::make_shared<bool>(false);
  CLI::App* command = cli::add_command(
      app, "shares", "List the weights of clients in fair share; all other clients have weight 1");
  add_connection_options(*command, invocation.connection);
  command->add_flag("--json", *json, "Print JSON (tessera.shares/1)");
  const auto to_set = std::make_shared<ShareOptions>();
  CLI::App* set = add_order(*command, invocation, "set", "Set the weight of a client in fair share",
                            to_set, set_share);
  set->add_option("weight", to_set->weight,
                  "Weight, 0.001 to 1000; a client of weight 3 gets three times as much as one of "
                  "weight 1")
      ->required()
      ->check(cli::finite_range(0.001, 1000));
  set->footer(
      "The weight replaces that of the server's option --client-share, also after restarts of the\n"
      "server. It counts for later leases.\n"
      "Example:\n  tessera shares set ann 3");
  add_order(*command, invocation, "reset",
            "Return a client to its weight in the server's options, or to 1",
            std::make_shared<ShareOptions>(), reset_share)
      ->footer("Example:\n  tessera shares reset ann");
  command->require_subcommand(0, 1);
  command->footer(
      "USAGE is what fair share compares: CPU time of the client's jobs, divided by its weight, "
      "with\n"
      "a half-life of one hour. The client with the least goes first.\n"
      "On farms with certificates, set and reset require an admin certificate, and a client sees\n"
      "only its own weight.\n"
      "Examples:\n  tessera shares\n  tessera shares set ann 3");
  command->callback([command, json, &invocation] {
    if (!command->get_subcommands().empty()) return;  // the subcommand has its own callback
    invocation.run = [json, &invocation] { return list_shares(*json, invocation.connection); };
  });
}

}  // namespace tessera::client
