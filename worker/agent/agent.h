#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "contract/unit.h"
#include "telemetry/log/log.h"
#include "worker/accel/layout/isa.h"

namespace tessera::agent {

struct AgentOptions {
  std::string server;     // unix:PATH or HOST:PORT
  std::string certs;      // folder of certificates; empty: none
  std::string token;      // the store's; with certificates, a join token
  std::string worker_id;  // empty: a random one
  std::string name;       // for people; empty: the host's
  std::vector<std::string> tags;
  int thread_count = 1;
  std::string cache_folder;
  std::int64_t cache_bytes = 20'000'000'000;
  std::int64_t buffer_bytes = 256'000'000;  // of blocks without a verdict
  std::int64_t memory_bytes = 0;            // see RendererOptions, as the next
  std::int64_t texel_bytes = 0;
  render::Isa isa = render::best_isa();  // what rays are traced with; supported
  std::string accelerator;               // see RendererOptions
  std::chrono::seconds unit_timeout{3600};
  std::chrono::seconds grace{20};  // from SIGTERM to the end
  std::string unit_log;            // file; empty: none
  std::string metrics;             // HOST:PORT where Prometheus may ask; empty: nowhere
  Log log = no_log;
  LogLevel log_level = LogLevel::info;  // the least that is told to the server, of lines about jobs
  std::optional<contract::Unit> crash_on;  // fault injection: the renderer dies of this unit
  bool deliver_twice = false;              // fault injection, as are those below
  bool forge = false;                      // false blocks go first, under leases it was not given
  int lie_every = 0;                       // every so many blocks have a wrong bit; 0: none
};

/// Works for a server until SIGTERM, SIGINT, a Drain, or a refusal.
///
/// On the first signal it says Leaving, hands back what it has not started, and ends once the rest
/// is acknowledged or `grace` is over; a second signal ends it at once. Call from the main thread,
/// before any other thread is started.
///
/// Errors: what the server refused the worker with; InvalidArgument, an option is unusable;
/// FailedPrecondition, the cache folder cannot be used; Internal, no renderer can be started.
absl::Status run_agent(const AgentOptions& given);

}  // namespace tessera::agent
