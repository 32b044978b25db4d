#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "client/commands.h"
#include "client/farm_client.h"
#include "client/table.h"

namespace tessera::client {
namespace {

struct WorkersOptions {
  bool json = false;
};

std::string state_name(v1::Worker::State state) {
  switch (state) {
    case v1::Worker::STATE_IDLE:
      return "idle";
    case v1::Worker::STATE_BUSY:
      return "busy";
    case v1::Worker::STATE_LEAVING:
      return "leaving";
    case v1::Worker::STATE_LOST:
      return "lost";
    case v1::Worker::STATE_SET_ASIDE:
      return "set aside";
    default:
      return "unknown";
  }
}

double seconds(const google::protobuf::Duration& span) {
  return static_cast<double>(span.seconds()) + 1e-9 * span.nanos();
}

nlohmann::ordered_json document_of(const v1::Worker& worker) {
  nlohmann::ordered_json tags = nlohmann::ordered_json::array();
  for (const std::string& tag : worker.tags()) tags.push_back(tag);
  return {{"id", worker.id()},
          {"name", worker.name()},
          {"host", worker.host()},
          {"state", state_name(worker.state())},
          {"isa", worker.isa()},
          {"threads", worker.thread_count()},
          {"tags", tags},
          {"units_leased", worker.leased_unit_count()},
          {"units_committed", worker.committed_unit_count()},
          {"cpu_seconds", worker.cpu_seconds()},
          {"rss_bytes", worker.rss_bytes()},
          {"silence_seconds", seconds(worker.silence())}};
}

int run(const WorkersOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto workers = (*client)->list_workers();
  if (!workers.ok()) return fail(workers.status());
  if (options.json) {
    nlohmann::ordered_json document = {{"schema", "tessera.workers/1"},
                                       {"workers", nlohmann::ordered_json::array()}};
    for (const v1::Worker& worker : *workers) document["workers"].push_back(document_of(worker));
    std::printf("%s\n", document.dump(2).c_str());
    return kExitDone;
  }
  Table table({"WORKER", "STATE", "THREADS", "ISA", "LEASED", "COMMITTED", "CPU S", "MEMORY",
               "HOST", "NAME"});
  for (const v1::Worker& worker : *workers) {
    table.add({worker.id(), state_name(worker.state()), std::to_string(worker.thread_count()),
               worker.isa(), std::to_string(worker.leased_unit_count()),
               std::to_string(worker.committed_unit_count()),
               absl::StrFormat("%.1f", worker.cpu_seconds()),
               format_bytes(static_cast<double>(worker.rss_bytes())), worker.host(),
               worker.name()});
  }
  std::fputs(table.text().c_str(), stdout);
  return kExitDone;
}

}  // namespace

void add_workers_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<WorkersOptions>();
  CLI::App* command =
      app.add_subcommand("workers", "List workers connected now or within the last hour");
  add_connection_options(*command, invocation.connection);
  command->add_flag("--json", options->json, "Print a JSON document (tessera.workers/1)");
  command->footer("Example:\n  tessera workers");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
