#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/job_status.h"
#include "client/request/limit_uses.h"

namespace tessera::client {
namespace {

struct SetOptions {
  std::string job;
  std::optional<int> priority, max_workers;
  std::optional<std::string> required_tag, pool;
  std::vector<std::string> limits;
  bool no_limits = false, no_after = false, json = false;

  bool changes_anything() const {
    return priority || max_workers || required_tag || pool || !limits.empty() || no_limits ||
           no_after;
  }
};

absl::StatusOr<v1::UpdateJobRequest> request_of(const SetOptions& options) {
  if (!options.changes_anything()) {
    return absl::InvalidArgumentError("set: give at least one option, such as --priority 50");
  }
  v1::UpdateJobRequest request;
  if (options.priority) request.set_priority(*options.priority);
  if (options.max_workers) request.set_max_worker_count(*options.max_workers);
  if (options.required_tag) request.set_required_tag(*options.required_tag);
  if (options.pool) request.set_pool(*options.pool);
  request.set_clear_dependencies(options.no_after);
  if (options.limits.empty() && !options.no_limits) return request;
  auto limits = parse_limit_uses(options.limits);
  if (!limits.ok()) return limits.status();
  *request.mutable_limits() = *std::move(limits);
  return request;
}

int run(const SetOptions& options, const Connection& connection) {
  auto request = request_of(options);
  if (!request.ok()) return fail(request.status());
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto found = (*client)->get_job(options.job);
  if (!found.ok()) return fail(found.status());
  request->set_job_id(found->id());
  const auto job = (*client)->update_job(*request);
  if (!job.ok()) return fail(job.status());
  if (options.json) {
    std::printf("%s\n", job_document(*job).dump(2).c_str());
  } else {
    std::printf("%s changed\n", job->id().c_str());
  }
  return kExitDone;
}

void add_options(CLI::App& command, SetOptions& options) {
  command.add_option("--priority", options.priority, "Priority; higher runs first")
      ->check(CLI::Range(-100, 100))
      ->type_name("P");
  command.add_option("--max-workers", options.max_workers, "Maximum workers at once; 0: unlimited")
      ->check(CLI::Range(0, 1'000'000))
      ->type_name("N");
  command
      .add_option("--require-tag", options.required_tag, "Tag that workers must have; \"\": none")
      ->type_name("TAG");
  command.add_option("--pool", options.pool, "Worker pool that renders the job")->type_name("POOL");
  CLI::Option* limits = command.add_option(
      "--limit", options.limits,
      "Limit that each leased unit counts against, and by how much (default: 1); replaces the "
      "job's limits; repeatable");
  limits->type_name("NAME[=AMOUNT]")->allow_extra_args(false);
  command.add_flag("--no-limits", options.no_limits, "Remove the job's limits")->excludes(limits);
  command.add_flag("--no-after", options.no_after, "Remove the job's dependencies on other jobs");
  command.add_flag("--json", options.json, "Print JSON (tessera.job/1)");
}

}  // namespace

void add_set_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<SetOptions>();
  CLI::App* command = cli::add_command(
      app, "set", "Change the priority, requirements, limits or dependencies of a job");
  add_connection_options(*command, invocation.connection);
  add_job_argument(*command, options->job);
  add_options(*command, *options);
  command->footer(
      "The change also applies to a job that is running; units already leased are still rendered.\n"
      "Examples:\n"
      "  tessera set last --priority 50\n"
      "  tessera set last --pool night --max-workers 4\n"
      "  tessera set last --no-after");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
