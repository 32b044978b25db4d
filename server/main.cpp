#include <openssl/rand.h>
#include <signal.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "cli/exit_codes.h"
#include "image/exr/exr_file.h"
#include "rpc/certificates/certificate_dates.h"
#include "server/config.h"
#include "server/coordinator/coordinator.h"
#include "server/identity/join_tokens.h"
#include "server/service/grpc_log.h"
#include "server/service/messages/job_messages.h"
#include "server/service/server.h"
#include "server/store/files/filesystem.h"
#include "server/store/store.h"
#include "telemetry/log/log.h"
#include "telemetry/metrics/listener.h"

namespace tessera::server {
namespace {

constexpr int kExitDamaged = 1;
constexpr std::int64_t kDayUs = std::int64_t{86'400} * 1'000'000;
constexpr std::int64_t kForgetJoinsDays = 90;
constexpr unsigned kMaxFilmThreads = 4;

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

std::uint64_t random_bits() {
  std::uint64_t bits = 0;
  RAND_bytes(reinterpret_cast<unsigned char*>(&bits), sizeof bits);
  return bits;
}

FarmOptions options_of(const Config& config) {
  FarmOptions options;
  options.policy.audit_fraction = config.audit_fraction;
  options.policy.client_priority = config.client_priority;
  options.policy.share.weights = parse_shares(config.client_shares).value();  // checked when parsed
  options.film_memory_bytes = to_bytes(config.film_memory_gb);
  // At least two, so that blocks are merged while a large image is written.
  options.film_threads =
      static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 2u, kMaxFilmThreads));
  options.ingest_bytes = to_bytes(config.ingest_memory_gb);
  options.quota_bytes = to_bytes(config.quota_gb);
  options.asset_quota_bytes = to_bytes(config.asset_quota_gb);
  options.job_retention_us =
      static_cast<std::int64_t>(config.job_retention_days * static_cast<double>(kDayUs));
  options.client_quotas = parse_quotas(config.quotas).value();  // checked when parsed
  options.clock = [] { return std::chrono::steady_clock::now(); };
  options.wall_us = wall_us;
  options.random = random_bits;
  options.read_spec = read_spec;
  options.write_request = write_request;
  options.log = open_log("tessera-server", config.log_level);
  return options;
}

/// Raises the limit of open files to the maximum: each connection needs a descriptor.
void raise_file_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

/// Prints the error and returns the exit code.
int fail(const absl::Status& status) {
  std::fprintf(stderr, "tessera-server: %s\n", std::string(status.message()).c_str());
  return absl::IsDataLoss(status) ? kExitDamaged : cli::exit_code(status.code());
}

/// fail() for errors of the store.
int fail_to_open(const std::string& store, const absl::Status& status) {
  if (!absl::IsDataLoss(status)) return fail(status);
  return fail(absl::DataLossError(absl::StrCat(
      std::string(status.message()),
      "; restore a backup, or keep what can be read: ", "`tessera-server recover ", store, "`")));
}

/// Ticks until SIGTERM or SIGINT, which must be blocked in every thread. Warns once a day of
/// certificates that end soon.
void tick_until_signal(Coordinator& coordinator, const sigset_t& signals, const std::string& certs,
                       const Log& log) {
  const timespec period{0, 100'000'000};
  auto due = std::chrono::steady_clock::now();
  while (::sigtimedwait(&signals, nullptr, &period) < 0) {
    coordinator.tick();
    if (std::chrono::steady_clock::now() < due) continue;
    due += std::chrono::hours(24);
    const std::string warning = contract::expiry_warning(certs, std::chrono::system_clock::now());
    if (!warning.empty()) log(LogLevel::warn, warning);
  }
}

/// Forgets workers that joined with tokens that no longer exist and have not connected for long.
absl::Status forget_old_joins(Store& store, const std::string& folder) {
  const std::int64_t now_us = wall_us();
  const auto tokens = JoinTokens(folder).list();
  if (!tokens.ok()) return tokens.status();
  std::vector<std::string> valid;
  for (const JoinToken& token : *tokens) {
    if (token.expires_s > now_us / 1'000'000) valid.push_back(token.id);
  }
  return store.workers().remove_stale_joins(valid, now_us - kForgetJoinsDays * kDayUs);
}

int serve(const Config& config, const sigset_t& signals) {
  const FarmOptions options = options_of(config);
  limit_grpc_log(options.log);
  StoreOptions store_options;
  store_options.warn = [log = options.log](const std::string& line) { log(LogLevel::warn, line); };
  store_options.synced = [metrics = options.metrics](double seconds) {
    metrics->fsync_seconds.Observe(seconds);
  };
  auto store = Store::open(config.store, real_filesystem(), std::move(store_options));
  if (!store.ok()) return fail_to_open(config.store, store.status());
  const absl::Status forgotten = forget_old_joins(**store, config.store);
  if (!forgotten.ok()) return fail_to_open(config.store, forgotten);
  auto coordinator = Coordinator::open(**store, options);
  if (!coordinator.ok()) return fail_to_open(config.store, coordinator.status());
  std::unique_ptr<MetricsListener> metrics;
  if (!config.metrics.empty()) {
    Health& health = (*coordinator)->health();
    auto started = MetricsListener::start(
        config.metrics, [&farm = **coordinator] { return farm.queries().metrics(); },
        {[&health] { return health.why_dead(); }, [&health] { return health.why_unready(); }});
    if (!started.ok()) return fail(started.status());
    metrics = *std::move(started);
    options.log(LogLevel::info, absl::StrCat("metrics: http://", metrics->address(), "/metrics"));
  }
  auto server = FarmServer::start(**coordinator, {config.listen, config.store, config.certs,
                                                  options.client_quotas, options.log});
  if (!server.ok()) return fail(server.status());
  std::thread writer([&] {
    while (!(*coordinator)->is_stopping()) (*coordinator)->run_writer(true);
  });
  std::thread answers([&] {
    while (!(*coordinator)->is_stopping()) (*coordinator)->run_answers(true);
  });
  image::set_exr_threads(options.film_threads);
  std::vector<std::thread> film_threads(static_cast<std::size_t>(options.film_threads));
  for (std::thread& thread : film_threads) {
    thread = std::thread([&] {
      while (!(*coordinator)->is_stopping()) (*coordinator)->run_film(true);
    });
  }
  std::printf("%s\n", (*server)->address().c_str());
  std::fflush(stdout);
  tick_until_signal(**coordinator, signals, config.certs, options.log);
  (*server)->stop();
  (*coordinator)->stop();
  writer.join();
  answers.join();
  for (std::thread& thread : film_threads) thread.join();
  // Writes pending blocks and changes; unfinished images are written again after the next start.
  while ((*coordinator)->run_writer(false) || (*coordinator)->run_answers(false)) {
  }
  return 0;
}

int run(int argc, char** argv) {
  const ParsedConfig parsed = parse_config(argc, argv);
  if (parsed.command) {
    const absl::Status status = parsed.command();
    return status.ok() ? 0 : fail(status);
  }
  if (!parsed.config) return parsed.exit_code;
  // Debian's Abseil looks for deadlocks: each lock of gRPC enters a graph that all threads share.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  signal(SIGPIPE, SIG_IGN);
  raise_file_limit();
  return serve(*parsed.config, signals);
}

}  // namespace
}  // namespace tessera::server

int main(int argc, char** argv) {
  return tessera::cli::end_process(tessera::server::run(argc, argv));
}
