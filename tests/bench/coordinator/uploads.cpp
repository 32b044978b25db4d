/// bench_coordinator_uploads: clients that upload large assets all the time, each with different
/// bytes, until the end of stdin; then prints their number and rate as one line of JSON.
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "rpc/channel.h"
#include "tests/bench/coordinator/client_options.h"
#include "tests/bench/coordinator/scene_upload.h"

namespace {

struct Options {
  std::string server, token;
  int clients = 4;
  int megabytes = 64;
};

/// Uploads assets until `stop`. Returns false if an upload fails.
bool upload_until(const std::atomic<bool>& stop, const Options& options, int client,
                  std::atomic<std::int64_t>& count) {
  const auto channel =
      tessera::contract::open_channel(options.server, "", tessera::contract::Keepalive::bulk);
  if (!channel.ok()) return false;
  std::string bytes(static_cast<std::size_t>(options.megabytes) << 20, 'x');
  for (int i = 0; !stop; ++i) {
    const std::string start =
        std::to_string(getpid()) + "-" + std::to_string(client) + "-" + std::to_string(i) + ";";
    bytes.replace(0, start.size(), start);
    if (!tessera::bench::upload(*channel, options.token, bytes)) return false;
    ++count;
  }
  return true;
}

int run(const Options& options) {
  std::atomic<bool> stop = false, has_failed = false;
  std::atomic<std::int64_t> count = 0;
  const auto begun = std::chrono::steady_clock::now();
  std::vector<std::thread> threads;
  for (int client = 0; client < options.clients; ++client) {
    threads.emplace_back([&, client] {
      if (!upload_until(stop, options, client, count)) has_failed = true;
    });
  }
  char byte = 0;
  while (read(STDIN_FILENO, &byte, 1) > 0) {
  }
  stop = true;
  for (std::thread& thread : threads) thread.join();
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - begun;
  printf("{\"clients\": %d, \"uploads\": %lld, \"megabytes_each\": %d, \"mb_per_second\": %.1f}\n",
         options.clients, static_cast<long long>(count), options.megabytes,
         static_cast<double>(count) * options.megabytes * 1.048576 / wall.count());
  return has_failed ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape): a bench may die of one
  Options options;
  CLI::App app("Clients that upload large assets for tests/bench/coordinator.");
  tessera::bench::add_server_options(app, options.server, options.token);
  app.add_option("--clients", options.clients, "how many")->capture_default_str();
  app.add_option("--megabytes", options.megabytes, "size of an asset, MiB")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return run(options);
}
