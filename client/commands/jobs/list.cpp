#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdio>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

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

constexpr std::array kStates = {v1::Job::STATE_QUEUED, v1::Job::STATE_RUNNING,
                                v1::Job::STATE_PAUSED, v1::Job::STATE_DONE,
                                v1::Job::STATE_FAILED, v1::Job::STATE_CANCELLED};

struct ListOptions {
  int limit = 20;
  bool json = false;
  std::vector<std::string> owners, states, projects, pools;
};

std::vector<std::string> state_names() {
  std::vector<std::string> names;
  for (const v1::Job::State state : kStates) names.push_back(state_name(state));
  return names;
}

v1::ListJobsRequest request_of(const ListOptions& options) {
  v1::ListJobsRequest request;
  *request.mutable_owners() = {options.owners.begin(), options.owners.end()};
  *request.mutable_projects() = {options.projects.begin(), options.projects.end()};
  *request.mutable_pools() = {options.pools.begin(), options.pools.end()};
  for (const v1::Job::State state : kStates) {
    if (std::count(options.states.begin(), options.states.end(), state_name(state)) > 0) {
      request.add_states(state);
    }
  }
  return request;
}

/// Returns the newest `limit` jobs of those requested; all of them for 0.
absl::StatusOr<std::vector<v1::Job>> newest_jobs(FarmClient& client, v1::ListJobsRequest request,
                                                 int limit) {
  std::vector<v1::Job> jobs;
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

/// Returns the time since the submission: seconds, minutes, hours or days.
std::string age_of(const v1::Job& job) {
  const std::int64_t age =
      std::max<std::int64_t>(0, std::time(nullptr) - job.create_time().seconds());
  if (age < 60) return absl::StrFormat("%d s", age);
  if (age < 3600) return absl::StrFormat("%d min", age / 60);
  if (age < 48 * 3600) return absl::StrFormat("%d h", age / 3600);
  return absl::StrFormat("%d d", age / 86400);
}

std::string or_dash(const std::string& text) {
  return text.empty() ? "-" : text;
}

struct Column {
  const char* title;
  std::string (*cell)(const v1::Job& job);
  /// Cell of a job that has nothing special; a column of such cells alone is left out, so that the
  /// table fits into a terminal. Null: the column is always printed.
  const char* usual = nullptr;
};

const Column kColumns[] = {
    {"JOB", [](const v1::Job& job) { return job.id(); }},
    {"STATE", [](const v1::Job& job) { return state_name(job.state()); }},
    {"DONE",
     [](const v1::Job& job) {
       return format_share(static_cast<double>(job.progress().committed_unit_count()),
                           static_cast<double>(job.progress().unit_count()));
     }},
    {"FRAMES",
     [](const v1::Job& job) {
       return absl::StrFormat("%d/%d", job.progress().finished_frame_count(),
                              job.progress().frame_count());
     }},
    {"ERROR",
     [](const v1::Job& job) {
       return job.progress().has_estimated_error()
                  ? absl::StrFormat("%.4f", job.progress().estimated_error())
                  : std::string("-");
     }},
    {"WORKERS", [](const v1::Job& job) { return std::to_string(job.progress().worker_count()); }},
    {"CPU S",
     [](const v1::Job& job) { return absl::StrFormat("%.1f", job.progress().cpu_seconds()); }},
    {"AGE", age_of},
    {"PRIORITY", [](const v1::Job& job) { return std::to_string(job.priority()); }, "0"},
    {"OWNER", [](const v1::Job& job) { return or_dash(job.owner()); }, "local"},
    {"PROJECT", [](const v1::Job& job) { return or_dash(job.project()); }, "-"},
    {"POOL", [](const v1::Job& job) { return or_dash(job.pool()); }, "default"},
    {"NAME", [](const v1::Job& job) { return job.name(); }},
    {"REASON",
     [](const v1::Job& job) { return or_dash(beginning_of_line(job.reason(), kMaxReasonLength)); }},
};

std::string table_of(const std::vector<v1::Job>& jobs) {
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows(jobs.size());
  for (const Column& column : kColumns) {
    std::vector<std::string> cells;
    for (const v1::Job& job : jobs) cells.push_back(column.cell(job));
    const bool is_usual = column.usual != nullptr &&
                          std::all_of(cells.begin(), cells.end(), [&](const std::string& cell) {
                            return cell == column.usual;
                          });
    if (is_usual) continue;
    header.emplace_back(column.title);
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i].push_back(std::move(cells[i]));
  }
  Table table(std::move(header));
  for (auto& row : rows) table.add(std::move(row));
  return table.text();
}

int run(const ListOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto jobs = newest_jobs(**client, request_of(options), options.limit);
  if (!jobs.ok()) return fail(jobs.status());
  if (options.json) {
    nlohmann::ordered_json document = {{"schema", "tessera.jobs/1"},
                                       {"jobs", nlohmann::ordered_json::array()}};
    for (const v1::Job& job : *jobs) document["jobs"].push_back(job_document(job));
    std::printf("%s\n", document.dump(2).c_str());
    return kExitDone;
  }
  std::fputs(table_of(*jobs).c_str(), stdout);
  return kExitDone;
}

/// Adds an option that may be repeated.
CLI::Option* add_filter(CLI::App& command, const char* name, std::vector<std::string>& values,
                        const char* description) {
  return command.add_option(name, values, std::string(description) + "; repeatable")
      ->expected(1)
      ->take_all()
      ->type_name("NAME");
}

}  // namespace

void add_list_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<ListOptions>();
  CLI::App* command = cli::add_command(app, "list", "List jobs, newest first");
  add_connection_options(*command, invocation.connection);
  command->add_option("--limit", options->limit, "Maximum number of jobs; 0: unlimited")
      ->capture_default_str()
      ->check(CLI::Range(0, 1'000'000'000));
  add_filter(*command, "--owner", options->owners, "Only jobs of this owner");
  add_filter(*command, "--state", options->states, "Only jobs in this state")
      ->check(CLI::IsMember(state_names()));
  add_filter(*command, "--project", options->projects,
             "Only jobs of this project; \"\": jobs without one");
  add_filter(*command, "--pool", options->pools, "Only jobs of this pool");
  command->add_flag("--json", options->json, "Print JSON (tessera.jobs/1)");
  command->footer(
      "A job is listed if it matches one value of each filter given. The columns PRIORITY, OWNER,\n"
      "PROJECT and POOL are left out if all listed jobs have priority 0, the owner `local`, no\n"
      "project or the pool `default`.\n"
      "Examples:\n  tessera list\n  tessera list --state running --state queued --owner ann\n"
      "  tessera list --limit 0 --json");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
