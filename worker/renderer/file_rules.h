#pragma once

#include "absl/status/statusor.h"

namespace tessera::agent {

/// Limits the files that this process can open, by Landlock: system libraries and data, its own
/// program's directory, and what /proc and /sys say about this process and the processors. Nothing
/// can be written, created, removed or executed; no signal leaves the process where the kernel
/// supports that. Open descriptors are not affected.
///
/// Requires that the process cannot gain privileges (PR_SET_NO_NEW_PRIVS) and has one thread.
/// Returns false if the kernel has no Landlock. Errors: Unavailable, the kernel refused a step.
absl::StatusOr<bool> limit_file_access();

}  // namespace tessera::agent
