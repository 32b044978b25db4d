#pragma once

#include "absl/status/status.h"

namespace tessera::client {

// Exit codes of every command; see docs/reference/exit-codes.md.
inline constexpr int kExitDone = 0;
inline constexpr int kExitJobFailed = 1;    // failed or cancelled job; comparison over its limit
inline constexpr int kExitBadInput = 2;     // wrong usage or bad input
inline constexpr int kExitUnreachable = 3;  // server unreachable, or it refused the request
inline constexpr int kExitUncertain = 4;    // images written, error target not certified
inline constexpr int kExitInterrupted = 130;

/// Returns the exit code of a command whose call or local step failed with `code`.
int exit_code(absl::StatusCode code);

/// Returns the exit code of a job that failed with `code`.
int failed_job_exit_code(absl::StatusCode code);

}  // namespace tessera::client
