#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera::server {

/// Accounts are kept by hours since 1970.
inline constexpr std::int64_t kHourUs = std::int64_t{3600} * 1'000'000;

/// CPU time of a group of jobs. Fields by which a query does not group are empty, and so are those
/// of jobs that were removed long ago.
struct UsageSum {
  std::string owner, project;
  std::int64_t job = 0;  // JobRecord::sequence
  std::string job_id, job_name;
  std::int64_t units = 0;  // committed
  double cpu_seconds = 0;
};

/// Selects and groups the use of jobs.
struct UsageQuery {
  bool by_owner = false, by_project = false, by_job = false;
  std::int64_t first_hour = 0, end_hour = std::int64_t{1} << 40;
  std::optional<std::string> owner = {}, project = {};
  std::optional<UsageSum> after = {};  // only groups after that of this one
};

/// Accounts of committed units: each unit counts once, in the hour of its commit, also after its
/// job is removed. A unit that was dropped because a worker was faulty or a block damaged does not
/// count. Written by UnitStore::commit() and UnitStore::drop().
class UsageStore {
 public:
  virtual ~UsageStore() = default;

  /// Returns up to `limit` groups by owner, project, job. Any thread; may be slow.
  virtual absl::StatusOr<std::vector<UsageSum>> read(const UsageQuery& query,
                                                     std::size_t limit) const = 0;
  /// Disk space of a job.
  struct Kept {
    std::int64_t image_bytes = 0, block_bytes = 0;
  };
  /// Returns what each job keeps, by JobRecord::sequence; jobs that keep nothing may be missing.
  virtual absl::StatusOr<std::map<std::int64_t, Kept>> kept() const = 0;
  /// Returns the sum of what matches, on the writing thread.
  virtual absl::StatusOr<double> cpu_seconds(const UsageQuery& query) const = 0;
};

}  // namespace tessera::server
