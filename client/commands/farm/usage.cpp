#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/time/time.h"
#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/cli/table.h"
#include "client/commands/farm/farm_commands.h"

namespace tessera::client {
namespace {

struct UsageOptions {
  std::vector<std::string> groups = {"owner", "project"};
  std::string since, until, owner;
  std::optional<std::string> project;
  bool json = false, csv = false;

  bool groups_by(const char* name) const {
    return std::find(groups.begin(), groups.end(), name) != groups.end();
  }
};

/// Reads a date or a time in UTC.
absl::StatusOr<google::protobuf::Timestamp> parse_time(const char* option,
                                                       const std::string& text) {
  absl::Time time;
  std::string error;
  if (!absl::ParseTime("%Y-%m-%d", text, &time, &error) &&
      !absl::ParseTime(absl::RFC3339_full, text, &time, &error)) {
    return absl::InvalidArgumentError(
        absl::StrCat(option, ": \"", text,
                     "\" is neither a date, 2026-11-30, nor a time, 2026-11-30T18:00:00Z"));
  }
  google::protobuf::Timestamp timestamp;
  timestamp.set_seconds(absl::ToUnixSeconds(time));
  return timestamp;
}

absl::StatusOr<v1::ListUsageRequest> request_of(const UsageOptions& options) {
  v1::ListUsageRequest request;
  if (options.groups_by("owner")) request.add_group_by(v1::ListUsageRequest::GROUP_OWNER);
  if (options.groups_by("project")) request.add_group_by(v1::ListUsageRequest::GROUP_PROJECT);
  if (options.groups_by("job")) request.add_group_by(v1::ListUsageRequest::GROUP_JOB);
  request.set_owner(options.owner);
  if (options.project) request.set_project(*options.project);
  if (!options.since.empty()) {
    auto time = parse_time("--since", options.since);
    if (!time.ok()) return time.status();
    *request.mutable_start_time() = *std::move(time);
  }
  if (!options.until.empty()) {
    auto time = parse_time("--until", options.until);
    if (!time.ok()) return time.status();
    *request.mutable_end_time() = *std::move(time);
  }
  if (request.has_start_time() && request.has_end_time() &&
      request.start_time().seconds() >= request.end_time().seconds()) {
    return absl::InvalidArgumentError(
        absl::StrCat("--until: ", options.until, " is not later than --since, ", options.since));
  }
  return request;
}

/// The columns by which the command groups.
struct Column {
  const char* name;
  const char* group;
  const std::string& (v1::Usage::*value)() const;
};

constexpr Column kColumns[] = {{"owner", "owner", &v1::Usage::owner},
                               {"project", "project", &v1::Usage::project},
                               {"job", "job", &v1::Usage::job_id},
                               {"name", "job", &v1::Usage::job_name}};

nlohmann::ordered_json document_of(const v1::Usage& usage, const UsageOptions& options) {
  nlohmann::ordered_json document = nlohmann::ordered_json::object();
  for (const Column& column : kColumns) {
    if (options.groups_by(column.group)) document[column.name] = (usage.*column.value)();
  }
  document["units"] = usage.unit_count();
  document["cpu_seconds"] = usage.cpu_seconds();
  return document;
}

/// Returns a field of a CSV file (RFC 4180).
std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  return absl::StrCat("\"", absl::StrReplaceAll(text, {{"\"", "\"\""}}), "\"");
}

void print_csv(const std::vector<v1::Usage>& all, const UsageOptions& options) {
  for (const Column& column : kColumns) {
    if (options.groups_by(column.group)) std::printf("%s,", column.name);
  }
  std::printf("units,cpu_seconds\n");
  for (const v1::Usage& usage : all) {
    for (const Column& column : kColumns) {
      if (!options.groups_by(column.group)) continue;
      std::printf("%s,", csv_field((usage.*column.value)()).c_str());
    }
    std::printf("%lld,%.6f\n", static_cast<long long>(usage.unit_count()), usage.cpu_seconds());
  }
}

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

void print_table(const std::vector<v1::Usage>& all, const UsageOptions& options) {
  std::vector<std::string> header;
  for (const Column& column : kColumns) {
    if (options.groups_by(column.group)) header.push_back(upper(column.name));
  }
  header.insert(header.end(), {"UNITS", "CPU HOURS"});
  Table table(header);
  for (const v1::Usage& usage : all) {
    std::vector<std::string> row;
    for (const Column& column : kColumns) {
      const std::string& value = (usage.*column.value)();
      if (options.groups_by(column.group)) row.push_back(value.empty() ? "-" : value);
    }
    row.push_back(std::to_string(usage.unit_count()));
    row.push_back(absl::StrFormat("%.4f", usage.cpu_seconds() / 3600));
    table.add(std::move(row));
  }
  std::fputs(table.text().c_str(), stdout);
}

int run(const UsageOptions& options, const Connection& connection) {
  const auto request = request_of(options);
  if (!request.ok()) return fail(request.status());
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto usage = (*client)->list_usage(*request);
  if (!usage.ok()) return fail(usage.status());
  if (options.json) {
    nlohmann::ordered_json document = {{"schema", "tessera.usage/1"},
                                       {"usage", nlohmann::ordered_json::array()}};
    for (const v1::Usage& entry : *usage) document["usage"].push_back(document_of(entry, options));
    std::printf("%s\n", document.dump(2).c_str());
  } else if (options.csv) {
    print_csv(*usage, options);
  } else {
    print_table(*usage, options);
  }
  return kExitDone;
}

}  // namespace

void add_usage_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<UsageOptions>();
  CLI::App* command =
      cli::add_command(app, "usage", "Show the CPU time that clients, projects and jobs have used");
  add_connection_options(*command, invocation.connection);
  command->add_option("--by", options->groups, "Comma-separated list of keys to group by")
      ->delimiter(',')
      ->check(CLI::IsMember({"owner", "project", "job"}))
      ->capture_default_str();
  command
      ->add_option("--since", options->since,
                   "Start of the time range in UTC, a date or time; whole hours are counted")
      ->type_name("TIME");
  command->add_option("--until", options->until, "End of the time range in UTC, exclusive")
      ->type_name("TIME");
  command->add_option("--owner", options->owner, "Only jobs of this client")->type_name("NAME");
  command
      ->add_option("--project", options->project,
                   "Only jobs of this project; \"\": jobs without one")
      ->type_name("NAME");
  CLI::Option* json = command->add_flag("--json", options->json, "Print JSON (tessera.usage/1)");
  command->add_flag("--csv", options->csv, "Print CSV")->excludes(json);
  command->footer(
      "Each committed unit counts once, even if its job has been removed. On farms with\n"
      "certificates a client sees only its own jobs.\n"
      "Examples:\n  tessera usage\n  tessera usage --by job --project film --csv\n"
      "  tessera usage --by owner --since 2026-11-01 --until 2026-12-01 --json");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
