#pragma once

#include <cstdint>

#include "absl/base/config.h"
#include "absl/status/statusor.h"
#include "worker/gltf/file/limits.h"

namespace tessera::agent {

// Sanitizers stop the threads of the process with ptrace, from a process that shares its memory,
// and look up symbols. The sandbox of builds with them allows this and limits no reading.
#if defined(ABSL_HAVE_ADDRESS_SANITIZER) || defined(ABSL_HAVE_THREAD_SANITIZER)
inline constexpr bool kHasSanitizer = true;
#else
inline constexpr bool kHasSanitizer = false;
#endif

/// Size limit of the only file that the renderer writes: the texels that exceed its memory, each
/// image on a page boundary.
inline constexpr std::int64_t kMaxFileBytes = 2 * std::int64_t{render::kMaxAllImageBytes};

/// Limits the memory of this process, without mappings of files, to `memory_bytes` (0: unlimited),
/// and every file that it writes to kMaxFileBytes.
void limit_resources(std::int64_t memory_bytes);

/// Result of enter_sandbox() besides the seccomp filter.
struct Confinement {
  /// By Landlock: to system libraries and what /proc says of this process.
  bool reads_are_limited = false;
};

/// Confines this process for its lifetime to what rendering needs, so that a scene that exploits a
/// parser reaches neither the network nor the disk nor another process.
///
/// A seccomp filter allows the system calls of rendering: memory, threads of this process, reading
/// files, and input and output on open descriptors. All others fail with EPERM: new sockets,
/// processes and programs, signals to others, opening files for writing, changing names. Where the
/// kernel has Landlock, files outside system directories cannot be opened at all; reading fails
/// with EACCES. Use of open descriptors stays allowed. The process cannot gain privileges.
///
/// Call it while the process has one thread. Errors: Unavailable, the kernel does not support
/// seccomp filters.
absl::StatusOr<Confinement> enter_sandbox();

}  // namespace tessera::agent
