/// bench_simulated_workers: runs simulated workers until SIGTERM or the end of stdin, then prints
/// their counters as one line of JSON. With --reconnect they follow a server that restarts, and the
/// time at which all are connected is printed each time, in microseconds of the monotonic clock.
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "contract/digest.h"
#include "contract/version.h"
#include "rpc/channel.h"
#include "rpc/credentials.h"
#include "tests/bench/coordinator/simulated_worker.h"

namespace {

struct Options {
  std::string server, certs, token, numerics = tessera::contract::kNumericsSha256, name = "sim";
  std::string first_leases;
  int workers = 1;
  int credits = 64;
  bool reconnects = false;
};

/// Opens a channel with a separate connection, like that of a worker on another machine.
std::shared_ptr<grpc::Channel> own_channel(
    const std::string& server, const std::shared_ptr<grpc::ChannelCredentials>& credentials) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(server, credentials, arguments);
}

/// Sends heartbeats and, with `reconnects`, connects workers again, until `stop`.
void keep_workers(const std::vector<std::unique_ptr<tessera::bench::SimulatedWorker>>& workers,
                  bool reconnects, const tessera::bench::Counters& counters,
                  const std::atomic<bool>& stop) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds kStep{10};
  Clock::time_point next_heartbeat = Clock::now() + std::chrono::seconds(1);
  bool were_all_connected = false;
  while (!stop) {
    std::this_thread::sleep_for(kStep);
    if (Clock::now() >= next_heartbeat) {
      next_heartbeat = Clock::now() + std::chrono::seconds(1);
      for (const auto& worker : workers) worker->send_heartbeat();
    }
    if (!reconnects) continue;
    for (const auto& worker : workers) worker->reconnect_if_due();
    const bool are_all_connected = counters.connected == static_cast<std::int64_t>(workers.size());
    if (are_all_connected && !were_all_connected) {
      const auto now = Clock::now().time_since_epoch();
      printf("%lld\n", static_cast<long long>(
                           std::chrono::duration_cast<std::chrono::microseconds>(now).count()));
      fflush(stdout);
    }
    were_all_connected = are_all_connected;
  }
}

int run(const Options& options) {
  using tessera::bench::SimulatedWorker;
  const auto numerics = tessera::contract::Digest::from_hex(options.numerics);
  if (!numerics) {
    fprintf(stderr, "--numerics: 64 hexadecimal digits\n");
    return 2;
  }
  std::shared_ptr<grpc::ChannelCredentials> credentials = grpc::InsecureChannelCredentials();
  if (!options.certs.empty()) {
    auto opened = tessera::contract::channel_credentials(options.certs);
    if (!opened.ok()) {
      fprintf(stderr, "%s\n", std::string(opened.status().message()).c_str());
      return 2;
    }
    credentials = *std::move(opened);
  }
  tessera::bench::Counters counters;
  tessera::bench::FilmShelf shelf(own_channel(options.server, credentials), options.token);
  std::vector<std::unique_ptr<SimulatedWorker>> workers;
  for (int i = 0; i < options.workers; ++i) {
    auto channel = own_channel(options.server, credentials);
    if (options.reconnects) {  // the pauses between attempts are those of a real worker
      channel = tessera::contract::open_channel(options.server, credentials);
    }
    workers.push_back(std::make_unique<SimulatedWorker>(
        std::move(channel),
        tessera::bench::SimulatedWorkerOptions{.id = options.name + "-" + std::to_string(i),
                                               .token = options.token,
                                               .numerics = numerics->binary(),
                                               .credits = options.credits,
                                               .reconnects = options.reconnects},
        shelf, counters));
    workers.back()->start();
  }
  std::atomic<bool> stop = false;
  std::thread keeper([&] { keep_workers(workers, options.reconnects, counters, stop); });
  char byte = 0;
  while (read(STDIN_FILENO, &byte, 1) > 0) {
  }
  stop = true;
  keeper.join();
  printf(
      "{\"workers\": %d, \"welcomed\": %lld, \"closed\": %lld, \"committed\": %lld, "
      "\"duplicate\": %lld, \"obsolete\": %lld, \"rejected\": %lld, \"bytes\": %lld, "
      "\"first_lease_us\": %lld, \"last_commit_us\": %lld, \"lease_p50_ms\": %.2f, "
      "\"lease_p99_ms\": %.2f, \"commit_p50_ms\": %.2f, \"commit_p99_ms\": %.2f}\n",
      options.workers, static_cast<long long>(counters.welcomed),
      static_cast<long long>(counters.closed), static_cast<long long>(counters.committed),
      static_cast<long long>(counters.duplicate), static_cast<long long>(counters.obsolete),
      static_cast<long long>(counters.rejected), static_cast<long long>(counters.committed_bytes),
      static_cast<long long>(counters.first_lease_us),
      static_cast<long long>(counters.last_commit_us), counters.lease.quantile_ms(0.5),
      counters.lease.quantile_ms(0.99), counters.commit.quantile_ms(0.5),
      counters.commit.quantile_ms(0.99));
  fflush(stdout);
  if (!options.first_leases.empty() && !counters.first_leases.write(options.first_leases)) {
    fprintf(stderr, "%s: cannot be written\n", options.first_leases.c_str());
  }
  _exit(0);  // streams are still open: a worker's crash is part of the protocol
}

}  // namespace

int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape): a bench may die of one
  Options options;
  CLI::App app("Simulated workers for tests/bench/coordinator.");
  app.add_option("--server", options.server, "unix:PATH or HOST:PORT")->required();
  app.add_option("--certs", options.certs, "directory of a worker's certificate");
  app.add_option("--token", options.token, "the server's token; with --certs, a join token");
  app.add_option("--numerics", options.numerics, "numerics hash to show")->capture_default_str();
  app.add_option("--name", options.name, "start of the workers' ids");
  app.add_option("--workers", options.workers, "how many");
  app.add_option("--first-leases", options.first_leases,
                 "file for the ID and the time of the first lease of each job");
  app.add_flag("--reconnect", options.reconnects, "connect again when the server has ended");
  app.add_option("--credits", options.credits, "units in flight, each");
  CLI11_PARSE(app, argc, argv);
  return run(options);
}
