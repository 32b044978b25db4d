#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace tessera::server {

/// The token in the file at `path`, made (64 hexadecimal digits, mode 0600) if there is none.
///
/// Errors: PermissionDenied, it can be read by others, or cannot be written; DataLoss, what is
/// there is no token.
absl::StatusOr<std::string> load_or_create_token(const std::string& path);

}  // namespace tessera::server
