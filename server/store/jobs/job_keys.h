#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Fields of a job's row that the functions need which write its units and frames.
struct JobKey {
  std::int64_t sequence = 0;      // the job in other tables
  std::int64_t next_segment = 0;  // unused, and above every released segment
};

/// Returns the key of a job that is not removed. On the writing thread. Errors: NotFound.
absl::StatusOr<JobKey> find_job(const Journal& journal, const std::string& job_id);

absl::Status no_such_job(const std::string& job_id);

/// Returns the number that a query over a job returns. `job`: JobKey::sequence. On the writing
/// thread.
absl::StatusOr<std::int64_t> sum_bytes(const Journal& journal, std::string_view sql,
                                       std::int64_t job);

}  // namespace tessera::server
