#pragma once

#include "absl/status/status.h"
#include "cli/exit_codes.h"

namespace tessera::client {

// Exit codes of every command; see docs/reference/exit-codes.md.
using cli::exit_code;
using cli::kExitBadInput;
using cli::kExitDone;
using cli::kExitInterrupted;
inline constexpr int kExitJobFailed = 1;  // job that did not succeed; comparison over its limit
inline constexpr int kExitUnreachable = cli::kExitUnavailable;
inline constexpr int kExitUncertain = 4;  // images written, error target not certified

/// Returns the exit code of a job that failed with `code`.
int failed_job_exit_code(absl::StatusCode code);

}  // namespace tessera::client
