#include <CLI/CLI.hpp>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/cli/table.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/job_status.h"

namespace tessera::client {
namespace {

constexpr int kPageSize = 100;
constexpr std::size_t kMaxReasonLength = 100;  // `tessera status` prints all of it

struct ListOptions {
  int limit = 20;
  bool json = false;
};

/// Returns the newest `limit` jobs; all of them for 0.
absl::StatusOr<std::vector<v1::Job>> newest_jobs(FarmClient& client, int limit) {
  std::vector<v1::Job> jobs;
  v1::ListJobsRequest request;
  do {
    const int wanted = limit == 0 ? kPageSize : limit - static_cast<int>(jobs.size());
    request.set_page_size(std::min(wanted, kPageSize));
    const auto page = client.list_jobs(request);
    if (!page.ok()) return page.status();
    jobs.insert(jobs.end(), page->jobs().begin(), page->jobs().end());
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty() &&
           (limit == 0 || jobs.size() < static_cast<std::size_t>(limit)));
  return jobs;
}

std::vector<std::string> row_of(const v1::Job& job) {
  const v1::JobProgress& progress = job.progress();
  return {
      job.id(),
      state_name(job.state()),
      format_share(static_cast<double>(progress.committed_unit_count()),
                   static_cast<double>(progress.unit_count())),
      absl::StrFormat("%d/%d", progress.finished_frame_count(), progress.frame_count()),
      progress.has_estimated_error() ? absl::StrFormat("%.4f", progress.estimated_error()) : "-",
      std::to_string(progress.worker_count()),
      absl::StrFormat("%.1f", progress.cpu_seconds()),
      job.name(),
      job.reason().empty() ? "-" : beginning_of_line(job.reason(), kMaxReasonLength)};
}

int run(const ListOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto jobs = newest_jobs(**client, options.limit);
  if (!jobs.ok()) return fail(jobs.status());
  if (options.json) {
    nlohmann::ordered_json document = {{"schema", "tessera.jobs/1"},
                                       {"jobs", nlohmann::ordered_json::array()}};
    for (const v1::Job& job : *jobs) document["jobs"].push_back(job_document(job));
    std::printf("%s\n", document.dump(2).c_str());
    return kExitDone;
  }
  Table table({"JOB", "STATE", "DONE", "FRAMES", "ERROR", "WORKERS", "CPU S", "NAME", "REASON"});
  for (const v1::Job& job : *jobs) table.add(row_of(job));
  std::fputs(table.text().c_str(), stdout);
  return kExitDone;
}

}  // namespace

void add_list_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<ListOptions>();
  CLI::App* command = cli::add_command(app, "list", "List jobs, newest first");
  add_connection_options(*command, invocation.connection);
  command->add_option("--limit", options->limit, "Maximum number of jobs; 0: unlimited")
      ->capture_default_str()
      ->check(CLI::Range(0, 1'000'000'000));
  command->add_flag("--json", options->json, "Print JSON (tessera.jobs/1)");
  command->footer("Examples:\n  tessera list\n  tessera list --limit 0 --json");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
