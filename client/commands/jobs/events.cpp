#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "cli/command.h"
#include "client/api/event_document.h"
#include "client/api/farm_client.h"
#include "client/api/signal_handler.h"
#include "client/commands/jobs/job_commands.h"

namespace tessera::client {
namespace {

struct EventsOptions {
  std::string job;  // empty: the whole farm
  bool follow = false;
  bool json = false;
  std::int64_t since = 0;  // only events after this sequence; 0: all that are kept
};

/// Replaces control characters, so that text from other machines cannot control the terminal.
std::string printable(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7F; }, ' ');
  return text;
}

std::string line_of(const v1::Event& event) {
  std::string line = event_time_text(event);
  if (!event.worker_id().empty()) absl::StrAppend(&line, " worker ", event.worker_id());
  if (event.kind() == v1::Event::KIND_LOG_LINE) {
    return absl::StrCat(line, ": ", printable(event.message()));
  }
  if (!event.job_id().empty()) absl::StrAppend(&line, " job ", event.job_id());
  absl::StrAppend(&line, " ", event_name(event.kind()));
  if (!event.message().empty()) absl::StrAppend(&line, ": ", printable(event.message()));
  return line;
}

/// Returns whether `event` is the last one of a job.
bool is_last(const v1::Event& event) {
  return event.kind() == v1::Event::KIND_JOB_DONE || event.kind() == v1::Event::KIND_JOB_FAILED ||
         event.kind() == v1::Event::KIND_JOB_CANCELLED ||
         event.kind() == v1::Event::KIND_JOB_REMOVED;
}

int run(const EventsOptions& options, const Connection& connection) {
  SignalHandler signals;
  auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const InterruptAction on_interrupt(signals, [&client] { (*client)->cancel(); });
  v1::WatchEventsRequest request;
  request.set_follow(options.follow);
  request.set_after_sequence(options.since);
  if (!options.job.empty()) {
    const auto job = (*client)->get_job(options.job);
    if (!job.ok()) return fail(job.status());
    request.set_job_id(job->id());
  }
  const absl::Status status = (*client)->watch_events(request, [&](const v1::Event& event) {
    const std::string text = options.json ? event_document(event).dump() : line_of(event);
    std::printf("%s\n", text.c_str());
    std::fflush(stdout);
    return !(options.follow && !options.job.empty() && is_last(event));
  });
  if (absl::IsCancelled(status)) return kExitInterrupted;
  return status.ok() ? kExitDone : fail(status);
}

CLI::App* add_command(CLI::App& app, Invocation& invocation, const char* name,
                      const char* description, const std::shared_ptr<EventsOptions>& options) {
  CLI::App* command = cli::add_command(app, name, description);
  add_connection_options(*command, invocation.connection);
  command->add_flag("--json", options->json, "Print JSON, one object per line (tessera.event/1)");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
  return command;
}

}  // namespace

void add_events_commands(CLI::App& app, Invocation& invocation) {
  const auto of_job = std::make_shared<EventsOptions>();
  CLI::App* logs =
      add_command(app, invocation, "logs", "Show the events and worker log lines of a job", of_job);
  add_job_argument(*logs, of_job->job);
  logs->add_flag("--follow", of_job->follow, "Print new events and lines until the job ends");
  logs->footer(
      "The server keeps the newest log lines of workers in memory, until it stops. Workers send "
      "lines at or above their --log-level; debug includes lines for every unit.\n"
      "Examples:\n  tessera logs last\n  tessera logs last --follow");

  const auto of_farm = std::make_shared<EventsOptions>();
  CLI::App* events = add_command(app, invocation, "events",
                                 "Show events of the farm: jobs, frames, workers", of_farm);
  events->add_flag("--follow", of_farm->follow, "Print new events until Ctrl-C");
  events
      ->add_option("--since", of_farm->since,
                   "Only events after this sequence number, as printed by --json")
      ->check(CLI::NonNegativeNumber)
      ->type_name("SEQUENCE");
  events->footer(
      "The server keeps the newest 200,000 events, across restarts. A program that stores the\n"
      "sequence number of the last event it has handled and passes it to --since sees each event\n"
      "once; if events after that number are no longer kept, the command fails.\n"
      "Examples:\n  tessera events\n  tessera events --follow --json\n"
      "  tessera events --since 1099511627790 --json");
}

}  // namespace tessera::client
