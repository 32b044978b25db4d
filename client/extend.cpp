#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/commands.h"
#include "client/farm_client.h"
#include "client/job_fate.h"
#include "proto/contract/pass_schedule.h"

namespace tessera::client {
namespace {

struct ExtendOptions {
  std::string job;
  std::int32_t spp = 0;
  bool json = false;
};

int run(const ExtendOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto found = (*client)->get_job(options.job);
  if (!found.ok()) return fail(found.status());
  const auto job = (*client)->extend_job(found->id(), options.spp);
  if (!job.ok()) return fail(job.status());
  if (options.json) {
    std::printf("%s\n", job_document(*job).dump(2).c_str());
  } else {
    std::printf("%s %s, now %d samples a pixel\n", job->id().c_str(),
                state_name(job->state()).c_str(), job->settings().sample_count());
  }
  return kExitDone;
}

}  // namespace

void add_extend_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<ExtendOptions>();
  CLI::App* command = app.add_subcommand("extend", "Raise the sample count of a job");
  add_connection_options(*command, invocation.connection);
  command->add_option("job", options->job, "Id, unique prefix, name, or last")->required();
  command->add_option("--spp", options->spp, "New number of samples a pixel, above the present one")
      ->required()
      ->check(CLI::Range(1, contract::kMaxSpp));
  command->add_flag("--json", options->json, "Print a JSON document (tessera.job/1)");
  command->footer(
      "The image is the one the job would have had with the new count from the start. Not possible "
      "once blocks of a finished frame are gone.\nExample:\n  tessera extend last --spp 1024");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
