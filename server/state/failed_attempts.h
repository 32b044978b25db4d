#pragma once

#include <string>
#include <vector>

#include "server/schedule/plan/job.h"

namespace tessera::server {

/// Writes failed attempts as JSON for a job's row: arrays of frame, tile, pass, worker and message;
/// "" if there are none.
std::string write_failed_attempts(const std::vector<FailedAttempt>& attempts);

/// Reads what write_failed_attempts() wrote; leaves out what it does not understand.
std::vector<FailedAttempt> read_failed_attempts(const std::string& text);

}  // namespace tessera::server
