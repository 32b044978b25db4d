// tessera-webhook: posts what happens on a farm to an HTTP address. A client of the farm as any
// other: the coordinator speaks to nobody outside it, and does not wait for those who do.
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
#include "client/cli/command.h"
#include "client/api/event_document.h"
#include "client/api/farm_client.h"
#include "client/api/signal_handler.h"
#include "webhook/event_relay.h"
#include "webhook/http_poster.h"
#include "cli/version_text.h"
#include "telemetry/log/log.h"

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
    return absl::InvalidArgumentError(absl::StrCat(path, ": there is no secret to read"));
  }
  return secret;
}

/// Calls `visit` with events after `after`; `follow`: for ever.
absl::Status watch(FarmClient& client, std::int64_t after, bool follow,
                   const std::function<bool(const v1::Event&)>& visit) {
  v1::WatchEventsRequest request;
  request.set_after_sequence(after);
  request.set_follow(follow);
  return client.watch_events(request, visit);
}

/// The sequence to begin after to pass on what happens from now on.
absl::StatusOr<std::int64_t> now(FarmClient& client, EventRelay& relay) {
  std::int64_t last = 0;
  absl::Status status = watch(client, 0, false, [&last](const v1::Event& event) {
    last = event.sequence();
    return true;
  });
  if (status.ok()) status = relay.remember(last);
  if (!status.ok()) return status;
  return last;
}

/// The sequence to begin after: where the last run ended; without a state file, now.
absl::StatusOr<std::int64_t> beginning(FarmClient& client, EventRelay& relay) {
  const auto kept = relay.last_sequence();
  if (!kept.ok()) return kept.status();
  if (*kept) return **kept;
  return now(client, relay);
}

/// Passes events on until something fails for good or `client` and `relay` are cancelled.
absl::Status pass_events(FarmClient& client, EventRelay& relay, const Log& log) {
  auto after = beginning(client, relay);
  while (after.ok()) {
    absl::Status passed;
    absl::Status watched = watch(client, *after, true, [&](const v1::Event& event) {
      passed = relay.pass(event);
      return passed.ok();
    });
    if (!passed.ok()) return passed;
    if (!absl::IsOutOfRange(watched)) return watched;
    log(LogLevel::warn,
        absl::StrCat(watched.message(), "; going on with what happens from now on"));
    after = now(client, relay);
  }
  return after.status();
}

absl::Status pass_on(const WebhookOptions& options, SignalHandler& interrupts) {
  auto secret = read_secret(options.secret_file);
  if (!secret.ok()) return secret.status();
  auto poster = HttpPoster::create({options.url, *secret});
  if (!poster.ok()) return poster.status();
  auto client = FarmClient::connect(options.connection);
  if (!client.ok()) return client.status();
  const Log log = open_log("tessera-webhook", options.log_level);
  EventRelay relay(**poster, options.relay, log);
  const InterruptAction on_interrupt(interrupts, [&client, &relay] {
    (*client)->cancel();
    relay.cancel();
  });
  return pass_events(**client, relay, log);
}

int run(const WebhookOptions& options) {
  SignalHandler interrupts;
  const absl::Status status = pass_on(options, interrupts);
  if (absl::IsCancelled(status)) return kExitDone;  // SIGTERM is how a service ends
  std::fprintf(stderr, "tessera-webhook: %s\n", std::string(status.message()).c_str());
  return exit_code(status);
}

void add_options(CLI::App& app, WebhookOptions& options) {
  add_connection_options(app, options.connection);
  app.get_option("--server")->envname("TESSERA_SERVER");
  app.get_option("--certs")->envname("TESSERA_CERTS");
  app.add_option("--url", options.url,
                 "Where to post, http://… or https://… (or TESSERA_WEBHOOK_URL, which other users "
                 "of the machine do not see)")
      ->envname("TESSERA_WEBHOOK_URL")
      ->required();
  app.add_option(
         "--secret", options.secret_file,
         "File with the secret that signs posts: Tessera-Signature: sha256=HMAC of the body")
      ->type_name("FILE");
  app.add_option("--kinds", options.relay.kinds,
                 "Only these, comma-separated: \"job done,job failed\" (default: all)")
      ->delimiter(',')
      ->check(CLI::IsMember(event_names()));
  app.add_option("--state", options.relay.state_file,
                 "File that keeps how far posts have come, to go on there after a restart; without "
                 "it, what happens from now on is posted")
      ->type_name("FILE");
  app.add_option("--log-level", options.log_level, "What goes to stderr")
      ->check(CLI::IsMember(log_level_names()))
      ->capture_default_str();
  app.set_version_flag(
      "--version",
      contract::version_text("tessera-webhook", TESSERA_VERSION, contract::kBaselineIsa,
                             {{"libcurl", curl_version_info(CURLVERSION_NOW)->version}}, {}));
  app.footer(
      "Posts each event as tessera.event/1 (as `tessera events --json` prints it), one at a time, "
      "in\n"
      "order, until it is taken (2xx): after 408, 425, 429, 5xx or no answer again in 1 s, then 2, "
      "up\n"
      "to 60 s; other answers leave the event out. A receiver may see one twice: same sequence.\n"
      "Example:\n"
      "  tessera-webhook --server unix:/run/tessera/server.sock --url https://chat.example/hook "
      "\\\n"
      "    --kinds \"job done,job failed,worker quarantined\" --state "
      "/var/lib/tessera-webhook/state");
}

}  // namespace
}  // namespace tessera::client

int main(int argc, char** argv) {
  using tessera::client::WebhookOptions;
  std::signal(SIGPIPE, SIG_IGN);
  WebhookOptions options;
  CLI::App app("Posts what happens on a Tessera farm to an HTTP address.", "tessera-webhook");
  tessera::client::add_options(app, options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? tessera::client::kExitDone : tessera::client::kExitBadInput;
  }
  return tessera::client::run(options);
}
