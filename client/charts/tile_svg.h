#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::client {

/// Returns an SVG image with two maps per frame of a report: estimated error and samples per pixel
/// of each tile, on a logarithmic colour scale. Adapts to light and dark backgrounds; tooltips show
/// the values of a tile.
///
/// Errors: FailedPrecondition, no frame of the report has statistics of its tiles.
absl::StatusOr<std::string> tile_svg(const nlohmann::ordered_json& report);

}  // namespace tessera::client
