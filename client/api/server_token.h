#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace tessera::client {

/// Returns the first line of the file with the server's token; without a file, TESSERA_TOKEN of the
/// environment, or an empty text. Errors: NotFound, naming the file.
absl::StatusOr<std::string> read_token(const std::string& file);

}  // namespace tessera::client
