#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "cli/finite_range.h"
#include "client/api/farm_client.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/job_status.h"
#include "contract/pass_schedule.h"

namespace tessera::client {
namespace {

struct ExtendOptions {
  std::string job;
  std::int32_t spp = 0;
  double error = 0;
  bool json = false;
};

int run(const ExtendOptions& options, const Connection& connection) {
  if (options.spp == 0 && options.error == 0) {
    return fail(absl::InvalidArgumentError("extend: --spp N or --error E is required"));
  }
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto found = (*client)->get_job(options.job);
  if (!found.ok()) return fail(found.status());
  const auto job = (*client)->extend_job(found->id(), options.spp, options.error);
  if (!job.ok()) return fail(job.status());
  if (options.json) {
    std::printf("%s\n", job_document(*job).dump(2).c_str());
  } else {
    const v1::RenderSettings& settings = job->settings();
    const std::string error = settings.has_error_target()
                                  ? absl::StrFormat("error %g, maximum ", settings.error_target())
                                  : "";
    std::printf("%s %s, now %s%d samples per pixel\n", job->id().c_str(),
                state_name(job->state()).c_str(), error.c_str(), settings.sample_count());
  }
  return kExitDone;
}

}  // namespace

void add_extend_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<ExtendOptions>();
  CLI::App* command =
      cli::add_command(app, "extend", "Raise the sample count of a job, or lower its target error");
  add_connection_options(*command, invocation.connection);
  add_job_argument(*command, options->job);
  command
      ->add_option(
          "--spp", options->spp,
          "New, higher number of samples per pixel; of a job with a target error, the maximum")
      ->check(CLI::Range(1, contract::kMaxSpp));
  command->add_option("--error", options->error, "New, lower target error")
      ->check(cli::finite_range(1e-6, 1.0));
  command->add_flag("--json", options->json, "Print JSON (tessera.job/1)");
  command->footer(
      "The result equals that of a job submitted with the new settings. The command fails "
      "if the job is done, because the results of its units are then deleted.\n"
      "Examples:\n"
      "  tessera extend last --spp 1024\n"
      "  tessera extend last --error 0.02");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
