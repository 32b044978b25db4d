#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::client {

/// Draws the tiles of a report's frames as SVG, a row of two maps a frame: the estimated error of
/// each tile and the samples its pixels have, in colours by the logarithm. Readable on light and
/// dark ground; the figures of a tile show under the pointer.
///
/// Errors: FailedPrecondition, no frame of the report has figures of its tiles (why).
absl::StatusOr<std::string> tile_svg(const nlohmann::ordered_json& report);

}  // namespace tessera::client
