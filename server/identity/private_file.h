#pragma once

#include <sys/types.h>

#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace tessera::server {

// Small files with secrets and lists. Errors are those of errno with the path: NotFound,
// PermissionDenied, ResourceExhausted, and so on.

constexpr mode_t kPrivate = 0600;  // a file that only its owner reads

/// Creates a directory of mode 0700 if missing.
absl::Status make_private_folder(const std::string& path);

/// Replaces a file atomically: a reader sees the old or the new bytes. Durable on return.
absl::Status write_file(const std::string& path, std::string_view bytes, mode_t mode);

/// Appends to a file, created with mode 0644 if missing. Durable on return.
absl::Status append_file(const std::string& path, std::string_view bytes);

/// Returns a file's bytes. Errors also: OutOfRange, it is larger than 64 MiB.
absl::StatusOr<std::string> read_file(const std::string& path);

}  // namespace tessera::server
