#pragma once

#include "absl/status/status.h"

namespace tessera::cli {

// Exit codes that all programs share; see docs/reference/exit-codes.md.
inline constexpr int kExitDone = 0;
inline constexpr int kExitBadInput = 2;     // wrong usage or bad input
inline constexpr int kExitUnavailable = 3;  // unreachable, refused or failed
inline constexpr int kExitInterrupted = 130;

/// Returns the exit code of a program that failed with `code`.
int exit_code(absl::StatusCode code);

/// Ends the process without destroying globals, and returns `exit_code` if it may not. gRPC ends
/// connection attempts that were given up on threads of its own, which would find globals
/// destroyed, and OpenSSL cleaned up.
int end_process(int exit_code);

}  // namespace tessera::cli
