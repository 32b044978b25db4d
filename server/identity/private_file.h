#pragma once

#include <sys/types.h>

#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace tessera::server {

// Small files with secrets and lists. Errors are errno's, with the path: NotFound,
// PermissionDenied, ResourceExhausted, …

/// Makes a folder of mode 0700 unless it is there.
absl::Status make_private_folder(const std::string& path);

/// Replaces a file as a whole: a reader sees the old bytes or the new. Durable on return.
absl::Status write_file(const std::string& path, std::string_view bytes, mode_t mode);

/// Adds at the end of a file, made with mode 0644 if need be. Durable on return.
absl::Status append_file(const std::string& path, std::string_view bytes);

/// A file's bytes. Errors also: OutOfRange, it has over 64 MiB.
absl::StatusOr<std::string> read_file(const std::string& path);

}  // namespace tessera::server
