#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <deque>
#include <memory>
#include <string>
#include <vector>

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
  std::int64_t since = 0;          // only events after this sequence; 0: all that are kept
  std::vector<std::string> kinds;  // empty: all
  int limit = 0;                   // only the newest ones; 0: all
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

bool is_wanted(const EventsOptions& options, const v1::Event& event) {
  return options.kinds.empty() ||
         std::count(options.kinds.begin(), options.kinds.end(), event_name(event.kind())) > 0;
}

void print(const EventsOptions& options, const v1::Event& event) {
  const std::string text = options.json ? event_document(event).dump() : line_of(event);
  std::printf("%s\n", text.c_str());
  std::fflush(stdout);
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
  std::deque<v1::Event> newest;  // with a limit: printed at the end
  const absl::Status status = (*client)->watch_events(request, [&](const v1::Event& event) {
    if (!is_wanted(options, event)) return true;
    if (options.limit == 0) {
      print(options, event);
    } else {
      newest.push_back(event);
      if (newest.size() > static_cast<std::size_t>(options.limit)) newest.pop_front();
    }
    return !(options.follow && !options.job.empty() && is_last(event));
  });
  for (const v1::Event& event : newest) print(options, event);
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
  CLI::Option* follow =
      events->add_flag("--follow", of_farm->follow, "Print new events until Ctrl-C");
  events
      ->add_option("--since", of_farm->since,
                   "Only events after this sequence number, as printed by --json")
      ->check(CLI::NonNegativeNumber)
      ->type_name("SEQUENCE");
  events
      ->add_option("--kind", of_farm->kinds,
                   "Only events of this kind, such as \"job failed\"; repeatable")
      ->expected(1)
      ->take_all()
      ->check(CLI::IsMember(event_names()));
  events->add_option("--limit", of_farm->limit, "Only the newest N of them; 0: unlimited")
      ->capture_default_str()
      ->check(CLI::Range(0, 1'000'000))
      ->excludes(follow);
  events->footer(
      "The server keeps the newest 200,000 events, across restarts. A program that stores the\n"
      "sequence number of the last event it has handled and passes it to --since sees each event\n"
      "once; if events after that number are no longer kept, the command fails.\n"
      "Examples:\n  tessera events --limit 20\n  tessera events --kind \"job failed\" --kind "
      "\"unit failed\"\n"
      "  tessera events --follow --json\n"
      "  tessera events --since 1099511627790 --json");
}

}  // namespace tessera::client
