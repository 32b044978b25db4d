#include "webhook/program.h"

#include <curl/curl.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "cli/command_line.h"
#include "cli/help_text.h"
#include "cli/version_text.h"
#include "client/api/event_document.h"
#include "client/api/farm_client.h"
#include "client/api/signal_handler.h"
#include "client/cli/command.h"
#include "telemetry/log/log.h"
#include "webhook/event_relay.h"
#include "webhook/http_poster.h"

namespace tessera::client {
namespace {

struct WebhookOptions {
  Connection connection;
  std::string url, secret_file;
  EventRelay::Options relay;
  std::string log_level = "info";
};

absl::StatusOr<std::string> read_secret(const std::string& path) {
  if (path.empty()) return "";
  std::ifstream file(path);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  const std::string secret(absl::StripAsciiWhitespace(text));
  if (!file || secret.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": cannot read a secret from this file"));
  }
  return secret;
}

/// Calls `visit` with the events after sequence `after`; with `follow`, without end.
absl::Status watch(FarmClient& client, std::int64_t after, bool follow,
                   const std::function<bool(const v1::Event&)>& visit) {
  v1::WatchEventsRequest request;
  request.set_after_sequence(after);
  request.set_follow(follow);
  return client.watch_events(request, visit);
}

/// Returns and stores the sequence of the latest event.
absl::StatusOr<std::int64_t> latest_sequence(FarmClient& client, EventRelay& relay) {
  std::int64_t last = 0;
  absl::Status status = watch(client, 0, false, [&last](const v1::Event& event) {
    last = event.sequence();
    return true;
  });
  if (status.ok()) status = relay.remember(last);
  if (!status.ok()) return status;
  return last;
}

/// Returns the sequence after which to start: that of the state file, else the latest.
absl::StatusOr<std::int64_t> start_sequence(FarmClient& client, EventRelay& relay) {
  const auto kept = relay.last_sequence();
  if (!kept.ok()) return kept.status();
  if (*kept) return **kept;
  return latest_sequence(client, relay);
}

/// Forwards events until a permanent error or until `client` and `relay` are cancelled.
absl::Status forward_events(FarmClient& client, EventRelay& relay, const Log& log) {
  auto after = start_sequence(client, relay);
  while (after.ok()) {
    absl::Status forwarded;
    absl::Status watched = watch(client, *after, true, [&](const v1::Event& event) {
      forwarded = relay.forward(event);
      return forwarded.ok();
    });
    if (!forwarded.ok()) return forwarded;
    if (absl::IsDataLoss(watched)) {
      log(LogLevel::warn, absl::StrCat(watched.message(), "; continuing with that one"));
      after = 0;
      continue;
    }
    if (!absl::IsOutOfRange(watched)) return watched;
    log(LogLevel::warn, absl::StrCat(watched.message(), "; continuing with new events only"));
    after = latest_sequence(client, relay);
  }
  return after.status();
}

absl::Status run_relay(const WebhookOptions& options, SignalHandler& signals) {
  auto secret = read_secret(options.secret_file);
  if (!secret.ok()) return secret.status();
  auto poster = HttpPoster::create({options.url, *secret});
  if (!poster.ok()) return poster.status();
  auto client = FarmClient::connect(options.connection);
  if (!client.ok()) return client.status();
  const Log log = open_log("tessera-webhook", options.log_level);
  EventRelay relay(**poster, options.relay, log);
  const InterruptAction on_interrupt(signals, [&client, &relay] {
    (*client)->cancel();
    relay.cancel();
  });
  return forward_events(**client, relay, log);
}

int run(const WebhookOptions& options) {
  SignalHandler signals;
  const absl::Status status = run_relay(options, signals);
  if (absl::IsCancelled(status)) return kExitDone;  // SIGTERM ends a service
  std::fprintf(stderr, "tessera-webhook: %s\n", std::string(status.message()).c_str());
  return exit_code(status.code());
}

void add_options(CLI::App& app, WebhookOptions& options) {
  add_connection_options(app, options.connection);
  app.get_option("--server")->envname("TESSERA_SERVER");
  app.get_option("--certs")->envname("TESSERA_CERTS");
  app.add_option(
         "--url", options.url,
         "Address of the receiver, http://… or https://… (or TESSERA_WEBHOOK_URL, which other "
         "users of the machine cannot see)")
      ->envname("TESSERA_WEBHOOK_URL")
      ->required();
  app.add_option(
         "--secret-file", options.secret_file,
         "File with the key for the signature header, Tessera-Signature: sha256=HMAC of the body")
      ->type_name("FILE");
  app.add_option("--events", options.relay.events,
                 "Comma-separated list of events, e.g. \"job done,job failed\" (default: all "
                 "except log line)")
      ->delimiter(',')
      ->check(CLI::IsMember(event_names()));
  app.add_option(
         "--state-file", options.relay.state_file,
         "File that stores the last posted event, to resume after a restart; without it, only "
         "new events are posted")
      ->type_name("FILE");
  app.add_option("--log-level", options.log_level, "Minimum level logged to stderr")
      ->check(CLI::IsMember(log_level_names()))
      ->capture_default_str();
  app.set_help_all_flag("--help-all", "Print this help");
  app.set_version_flag(
      "--version",
      cli::version_text("tessera-webhook", TESSERA_VERSION, cli::kBaselineIsa,
                        {{"libcurl", curl_version_info(CURLVERSION_NOW)->version}}, {}));
  app.footer(
      "Posts each event as a tessera.event/1 document, as printed by `tessera events --json`, in "
      "order "
      "and one at a time, until the receiver responds 2xx. After 408, 425, 429, 5xx or no response "
      "it "
      "retries in 1 s, 2 s, up to 60 s; after any other response it skips the event. A receiver "
      "may see an event twice, with the same sequence.\n"
      "Example:\n"
      "  tessera-webhook --server unix:/run/tessera/server.sock --url https://chat.example/hook "
      "\\\n"
      "    --events \"job done,job failed,worker quarantined\" --state-file "
      "/var/lib/tessera-webhook/state");
}

}  // namespace

int run_webhook(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  WebhookOptions options;
  CLI::App app("Posts the events of a Tessera farm to an HTTP address.", "tessera-webhook");
  app.formatter(cli::help_formatter());
  add_options(app, options);
  if (const auto ended = cli::parse(app, argc, argv)) return *ended;
  return run(options);
}

}  // namespace tessera::client
