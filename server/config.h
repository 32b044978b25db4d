#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/quota_options.h"

namespace tessera::server {

/// Settings from the command line or the configuration file.
struct Config {
  std::string listen;              // unix:PATH or HOST:PORT; port 0: any free port
  std::string store;               // directory of the store; created if missing
  std::string certs;               // directory of certificates; empty: none
  double film_memory_gb = 1;       // merged tiles in memory
  double ingest_memory_gb = 0.25;  // delivered blocks that are not committed
  double quota_gb = 1000;          // store size above which jobs are refused
  double asset_quota_gb = 64;      // size above which unused assets are deleted
  double job_retention_days = 0;   // age after its end at which a job is removed; 0: never
  double audit_fraction = 0.01;    // of units re-rendered by a second worker
  QuotaOptions quotas;
  std::int32_t client_priority = 100;      // maximum priority of clients' jobs; admins: any
  std::vector<std::string> client_shares;  // NAME=WEIGHT: weights of fair share; others have 1
  std::string log_level = "info";
  std::string metrics;  // HOST:PORT of the Prometheus endpoint; empty: none
};

/// The configuration, or a command to run instead, or the exit code: 0 after --help or --version, 2
/// for wrong usage (reported on stderr).
struct ParsedConfig {
  std::optional<Config> config;
  std::function<absl::Status()> command;
  int exit_code = 0;
};
ParsedConfig parse_config(int argc, char** argv);

/// Returns the weights in `NAME=WEIGHT`, by name. Errors: InvalidArgument, no name, or a weight
/// outside [0.001, 1000].
absl::StatusOr<std::map<std::string, double>> parse_shares(const std::vector<std::string>& shares);

/// Converts gigabytes to bytes.
std::int64_t to_bytes(double gigabytes);

}  // namespace tessera::server
