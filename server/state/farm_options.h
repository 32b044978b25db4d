#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/schedule/tables/policy.h"
#include "server/state/client_quota.h"
#include "server/store/store.h"
#include "server/telemetry/farm_metrics.h"
#include "telemetry/log/log.h"

namespace tessera::server {

/// Free space of the store's disk that jobs need: a few groups of blocks and images. With less,
/// jobs that may fill it are refused, and those that were paused because the disk was full stay
/// paused.
inline constexpr std::int64_t kRoomForJobs = std::int64_t{256} << 20;

/// Settings of a farm, and what it takes from outside: clocks, randomness, the form of requests.
struct FarmOptions {
  SchedulePolicy policy;
  std::int64_t film_memory_bytes = std::int64_t{1} << 30;
  int film_threads = 1;  // threads that run Coordinator::run_film()
  std::int64_t image_memory_bytes = std::int64_t{512} << 20;  // of large images being written
  std::int64_t ingest_bytes = std::int64_t{256} << 20;        // delivered and not committed
  std::int64_t quota_bytes = std::int64_t{1} << 40;           // of the store
  std::int64_t asset_quota_bytes = std::int64_t{64} << 30;
  std::int64_t job_retention_us = 0;  // age after its end at which a job is removed; 0: never
  ClientQuotas client_quotas;
  Duration tick_period = std::chrono::milliseconds(100);
  std::function<Time()> clock;  // monotonic
  /// Wall clock, µs since 1970: for time stamps, and for the age of jobs that ended before a start.
  std::function<std::int64_t()> wall_us;
  std::function<std::uint64_t()> random;  // for job IDs
  /// Parses a job's row: settings, manifest, limits. Errors: DataLoss.
  std::function<absl::StatusOr<JobSpec>(const JobRecord&)> read_spec;
  /// Serialises the request of a job with the sample count and target error of `spec`.
  std::function<std::string(const JobSpec& spec)> write_request;
  Log log;  // may be empty
  /// Owners: the farm and its creator, who may record into it too.
  std::shared_ptr<FarmMetrics> metrics = std::make_shared<FarmMetrics>();
};

}  // namespace tessera::server
