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

}  // namespace tessera::cli
