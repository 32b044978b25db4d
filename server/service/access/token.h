#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace tessera::server {

/// Returns the token in the file at `path`; creates it (64 hexadecimal digits, mode 0600) if
/// missing.
///
/// Errors: PermissionDenied, other users can read the file, or it cannot be written; DataLoss, its
/// content is not a token.
absl::StatusOr<std::string> load_or_create_token(const std::string& path);

}  // namespace tessera::server
