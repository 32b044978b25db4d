#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/status.h"

namespace tessera::server {

/// What tessera-server is told on its command line or in its configuration file.
struct Config {
  std::string listen;              // unix:PATH or HOST:PORT; port 0: any
  std::string store;               // folder of the store; made if needed
  std::string certs;               // folder of certificates; empty: none
  double film_memory_gb = 1;       // of merged tiles kept in memory
  double ingest_memory_gb = 0.25;  // of delivered blocks not yet committed
  double quota_gb = 1000;          // of the store, jobs beyond it are refused
  double asset_quota_gb = 64;      // beyond it assets no job names are deleted
  double job_retention_days = 0;   // jobs that ended so long ago are removed; 0: never
  double audit_fraction = 0.01;    // share of units that a second worker renders again
  // Of each owner's unfinished jobs; 0: no limit.
  std::int64_t client_jobs = 0;
  double client_gigasamples = 0, client_gb = 0;
  // Of each client, with certificates; 0: any number.
  double client_calls = 500, client_upload_gb = 50;
  std::string log_level = "info";
  std::string metrics;  // HOST:PORT where Prometheus may ask; empty: nowhere
};

/// The configuration, or another command to run instead, or else the exit code to end with: 0 after
/// --help or --version, 2 for wrong usage (said on stderr).
struct ParsedConfig {
  std::optional<Config> config;
  std::function<absl::Status()> command;
  int exit_code = 0;
};
ParsedConfig parse_config(int argc, char** argv);

/// `gigabytes` in bytes.
std::int64_t to_bytes(double gigabytes);

}  // namespace tessera::server
