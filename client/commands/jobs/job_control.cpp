#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/job_status.h"

namespace tessera::client {
namespace {

struct ControlOptions {
  std::string job;
  bool json = false;
};

/// A command that changes the state of a job and prints it.
struct Control {
  const char* name;
  const char* description;
  const char* footer;
  absl::StatusOr<v1::Job> (FarmClient::*call)(const std::string& job_id);
};

constexpr Control kControls[] = {
    {"pause", "Stop leasing a job's units; units already leased are still committed",
     "Examples:\n  tessera pause last\n  tessera resume last", &FarmClient::pause_job},
    {"resume", "Resume a paused job", "Example:\n  tessera resume last", &FarmClient::resume_job},
    {"cancel", "Cancel a job; committed units are kept",
     "`tessera retry JOB` resumes the job, `tessera remove JOB` deletes it.\n"
     "Example:\n  tessera cancel last",
     &FarmClient::cancel_job},
    {"retry",
     "Resume a job that has failed, was cancelled or is paused because of failures, from its "
     "committed units",
     "Example:\n  tessera retry last", &FarmClient::retry_job},
};

void print_job(const v1::Job& job, bool json) {
  if (json) {
    std::printf("%s\n", job_document(job).dump(2).c_str());
  } else {
    std::printf("%s %s\n", job.id().c_str(), state_name(job.state()).c_str());
  }
}

int run(const Control& control, const ControlOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto found = (*client)->get_job(options.job);
  if (!found.ok()) return fail(found.status());
  const auto job = ((**client).*control.call)(found->id());
  if (!job.ok()) return fail(job.status());
  print_job(*job, options.json);
  return kExitDone;
}

int run_remove(const ControlOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto found = (*client)->get_job(options.job);
  if (!found.ok()) return fail(found.status());
  if (const absl::Status status = (*client)->remove_job(found->id()); !status.ok()) {
    return fail(status);
  }
  if (options.json) {
    const nlohmann::ordered_json document = {{"schema", "tessera.removed/1"}, {"id", found->id()}};
    std::printf("%s\n", document.dump(2).c_str());
  } else {
    std::printf("%s removed\n", found->id().c_str());
  }
  return kExitDone;
}

CLI::App* add_command(CLI::App& app, Invocation& invocation, const char* name,
                      const char* description, ControlOptions& options) {
  CLI::App* command = cli::add_command(app, name, description);
  add_connection_options(*command, invocation.connection);
  add_job_argument(*command, options.job);
  command->add_flag("--json", options.json, "Print JSON");
  return command;
}

}  // namespace

void add_job_control_commands(CLI::App& app, Invocation& invocation) {
  for (const Control& control : kControls) {
    auto options = std::make_shared<ControlOptions>();
    CLI::App* command = add_command(app, invocation, control.name, control.description, *options);
    command->footer(control.footer);
    command->callback([options, &control, &invocation] {
      invocation.run = [options, &control, &invocation] {
        return run(control, *options, invocation.connection);
      };
    });
  }
  auto options = std::make_shared<ControlOptions>();
  CLI::App* command = add_command(app, invocation, "remove",
                                  "Delete an ended job with its blocks and images", *options);
  command->footer("Downloaded files are kept.\nExample:\n  tessera remove last");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run_remove(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
