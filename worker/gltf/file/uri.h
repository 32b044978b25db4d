#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera::render {

/// Returns whether `uri` is a data URI.
bool is_data_uri(std::string_view uri);

/// Decodes a data URI, base64 or percent-encoded. Errors: InvalidArgument.
absl::StatusOr<std::vector<std::byte>> decode_data_uri(std::string_view uri);

/// The percent-decoded path of a relative URI. Errors: InvalidArgument for schemes, absolute paths,
/// `..`, backslashes, control characters, bad escapes and queries.
absl::StatusOr<std::string> relative_path(std::string_view uri);

}  // namespace tessera::render
