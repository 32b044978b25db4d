#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/cli/table.h"
#include "client/commands/farm/farm_commands.h"

namespace tessera::client {
namespace {

nlohmann::ordered_json document_of(const std::vector<v1::ClientQuotas>& clients) {
  nlohmann::ordered_json document = {{"schema", "tessera.quotas/1"},
                                     {"clients", nlohmann::ordered_json::array()}};
  for (const v1::ClientQuotas& client : clients) {
    nlohmann::ordered_json quotas = nlohmann::ordered_json::array();
    for (const v1::QuotaUse& use : client.quotas()) {
      quotas.push_back({{"quota", use.quota()}, {"used", use.used()}, {"limit", use.limit()}});
    }
    document["clients"].push_back({{"client", client.client()}, {"quotas", std::move(quotas)}});
  }
  return document;
}

constexpr double kGiga = 1e9;  // as in the server's options

/// Returns whether the unit of the quota is 10⁹ bytes.
bool is_bytes(const v1::QuotaUse& use) {
  return use.quota() == "gb" || absl::EndsWith(use.quota(), "-gb");
}

/// Returns an amount of the quota with its unit.
std::string amount_text(const v1::QuotaUse& use, double amount) {
  return is_bytes(use) ? format_bytes(kGiga * amount) : absl::StrFormat("%.4g", amount);
}

void print_table(const std::vector<v1::ClientQuotas>& clients) {
  Table table({"CLIENT", "QUOTA", "USED", "LIMIT", "SHARE"});
  for (const v1::ClientQuotas& client : clients) {
    for (const v1::QuotaUse& use : client.quotas()) {
      table.add({client.client(), use.quota(), amount_text(use, use.used()),
                 use.limit() == 0 ? "unlimited" : amount_text(use, use.limit()),
                 format_share(use.used(), use.limit())});
    }
  }
  std::fputs(table.text().c_str(), stdout);
}

int run(bool json, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto clients = (*client)->list_quotas();
  if (!clients.ok()) return fail(clients.status());
  if (json) {
    std::printf("%s\n", document_of(*clients).dump(2).c_str());
  } else {
    print_table(*clients);
  }
  return kExitDone;
}

}  // namespace

void add_quotas_command(CLI::App& app, Invocation& invocation) {
  auto json = std::make_shared<bool>(false);
  CLI::App* command = cli::add_command(app, "quotas", "Show the quotas of clients and their use");
  add_connection_options(*command, invocation.connection);
  command->add_flag("--json", *json, "Print JSON (tessera.quotas/1)");
  command->footer(
      "A request that would exceed a quota is refused. The operator sets quotas with the options\n"
      "--client-QUOTA and --client-quota of tessera-server. On farms with certificates a client\n"
      "sees only its own quotas.\n"
      "Examples:\n  tessera quotas\n  tessera quotas --json");
  command->callback([json, &invocation] {
    invocation.run = [json, &invocation] { return run(*json, invocation.connection); };
  });
}

}  // namespace tessera::client
