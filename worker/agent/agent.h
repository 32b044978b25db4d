#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "telemetry/log/log.h"
#include "worker/accel/layout/isa.h"
#include "worker/agent/units/fault_hooks.h"

namespace tessera::agent {

struct AgentOptions {
  std::string server;     // unix:PATH or HOST:PORT
  std::string certs;      // directory of certificates; empty: no TLS
  std::string token;      // the server's token; with certificates, a join token
  std::string worker_id;  // empty: the one of an earlier worker: claim_worker_id()
  std::string name;       // display name; empty: the host name
  std::vector<std::string> tags;
  std::string pool;  // empty: the default one
  int thread_count = 1;
  std::string cache_folder;  // directory of the asset cache
  std::int64_t cache_bytes = 20'000'000'000;
  std::int64_t buffer_bytes = 256'000'000;  // limit of unacknowledged blocks
  std::int64_t memory_bytes = 0;            // RendererOptions::memory_bytes
  std::int64_t texel_bytes = 0;             // RendererOptions::texel_bytes
  render::Isa isa = render::best_isa();     // instruction set for ray traversal; supported
  std::chrono::seconds unit_timeout{3600};
  std::chrono::seconds grace{20};  // from SIGTERM to exit
  std::string unit_log;            // path of the UnitLog; empty: none
  std::string metrics;             // HOST:PORT of the Prometheus endpoint; empty: none
  Log log = no_log;
  LogLevel log_level = LogLevel::info;  // minimum level of job lines sent to the server
  FaultHooks faults;                    // empty except in test builds
};

/// Works for a server until SIGTERM, SIGINT, a Drain message, or a refusal.
///
/// On the first signal the worker announces that it is draining, returns the units it has not
/// started, and exits when the rest is acknowledged or `grace` is over. A second signal ends the
/// process at once. Call from the main thread, before any other thread is started.
///
/// Errors: PermissionDenied, the server refused the worker; InvalidArgument, an option is unusable;
/// FailedPrecondition, the cache directory or the unit log cannot be written; Unavailable, the
/// metrics port is in use; Internal, no renderer can be started.
absl::Status run_agent(const AgentOptions& given);

}  // namespace tessera::agent
