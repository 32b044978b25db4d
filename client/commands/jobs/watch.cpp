#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "cli/command.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/job_status.h"

namespace tessera::client {
namespace {

struct WatchOptions {
  std::string job;
  bool json = false;
};

int run(const WatchOptions& options, const Connection& connection) {
  SignalHandler signals;
  auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto job = (*client)->get_job(options.job);
  if (!job.ok()) return fail(job.status());
  return watch_until_finished(**client, signals, job->id(), options.json);
}

}  // namespace

void add_watch_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<WatchOptions>();
  CLI::App* command = cli::add_command(app, "watch", "Follow a job until it ends");
  add_connection_options(*command, invocation.connection);
  add_job_argument(*command, options->job);
  command->add_flag("--json", options->json, "Print JSON, one object per line (tessera.job/1)");
  command->footer(
      "Exit code: 0 done, 1 failed, cancelled or paused by failures, 2 the scene is faulty, 4 done "
      "but the target "
      "error is not certified. Ctrl-C leaves the job running.\nExample:\n  tessera watch last");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
