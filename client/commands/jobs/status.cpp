#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/cli/progress.h"
#include "client/cli/table.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/job_status.h"

namespace tessera::client {
namespace {

struct StatusOptions {
  std::string job;
  bool json = false;
};

/// Adds what the job requires of workers, limits and other jobs.
void add_requirements(const v1::Job& job, Table& table) {
  if (!job.owner().empty()) table.add({"owner", job.owner()});
  table.add({"priority", std::to_string(job.priority())});
  table.add({"pool", job.pool()});
  if (job.max_worker_count() > 0) {
    table.add({"max workers", std::to_string(job.max_worker_count())});
  }
  if (!job.required_tag().empty()) table.add({"tag", job.required_tag()});
  for (const v1::LimitUse& use : job.limits()) {
    table.add({"limit", absl::StrCat(use.limit(), ", ", use.unit_count(), " for each unit")});
  }
  for (const v1::JobDependency& dependency : job.dependencies()) {
    table.add({dependency_name(dependency.kind()), absl::StrCat("job ", dependency.job_id())});
  }
  if (!job.project().empty()) table.add({"project", job.project()});
  for (const std::string& worker : job.blocked_worker_ids()) table.add({"blocked", worker});
}

/// Adds what failed, where and why, and what to do.
void add_failures(const v1::Job& job, Table& table) {
  for (const v1::FailedAttempt& attempt : job.failed_attempts()) {
    table.add({"failed", absl::StrCat("frame ", attempt.frame(), ", tile ", attempt.tile(),
                                      ", pass ", attempt.pass(), ", worker ", attempt.worker_id(),
                                      ": ", attempt.message())});
  }
  if (!is_paused_by_failures(job)) return;
  table.add({"next", absl::StrCat("`tessera logs ", job.id(), "` has the renderer's last lines, `",
                                  "tessera retry ", job.id(), "` resumes the job")});
}

/// Returns the state with its reason; failures have rows of their own.
std::string state_text(const v1::Job& job) {
  if (is_paused_by_failures(job)) {
    return absl::StrCat(state_name(job.state()), ": units kept failing");
  }
  return job.reason().empty() ? state_name(job.state())
                              : absl::StrCat(state_name(job.state()), ": ", job.reason());
}

std::string text_of(const v1::Job& job) {
  const v1::JobProgress& progress = job.progress();
  Table table({"job", absl::StrCat(job.id(), "  ", job.name())});
  table.add({"state", state_text(job)});
  add_failures(job, table);
  table.add({"frames", absl::StrCat(progress.finished_frame_count(), " of ", progress.frame_count(),
                                    " finished")});
  table.add(
      {"units",
       absl::StrCat(progress.committed_unit_count(), " of ", progress.unit_count(), " committed (",
                    format_share(static_cast<double>(progress.committed_unit_count()),
                                 static_cast<double>(progress.unit_count())),
                    "), ", progress.leased_unit_count(), " leased")});
  table.add({"samples",
             absl::StrCat(progress.committed_sample_count(), " of ", progress.sample_count())});
  table.add({"error", progress.has_estimated_error()
                          ? absl::StrFormat("%.5f (estimated)", progress.estimated_error())
                          : "unknown"});
  table.add({"workers", std::to_string(progress.worker_count())});
  add_requirements(job, table);
  table.add({"cpu", absl::StrFormat("%.1f s", progress.cpu_seconds())});
  table.add({"elapsed", format_seconds(to_seconds(progress.elapsed()))});
  if (progress.has_remaining()) {
    table.add({"remaining", format_seconds(to_seconds(progress.remaining()))});
  }
  return table.text();
}

int run(const StatusOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto job = (*client)->get_job(options.job);
  if (!job.ok()) return fail(job.status());
  const std::string text = options.json ? job_document(*job).dump(2) + "\n" : text_of(*job);
  std::fputs(text.c_str(), stdout);
  return kExitDone;
}

}  // namespace

void add_status_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<StatusOptions>();
  CLI::App* command = cli::add_command(app, "status", "Show the state and progress of a job");
  add_connection_options(*command, invocation.connection);
  add_job_argument(*command, options->job);
  command->add_flag("--json", options->json, "Print JSON (tessera.job/1)");
  command->footer("Examples:\n  tessera status last\n  tessera status 4f2a --json");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
