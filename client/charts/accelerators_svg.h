#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::client {

/// Returns an SVG chart of the member "accelerators" of tessera.inspect/1, all axes logarithmic:
/// CPU time per ray against build time, and visited nodes plus tested primitives per ray against
/// memory. Both are means over all rays of the table. Adapts to light and dark backgrounds.
///
/// Errors: FailedPrecondition, the table has no measurements.
absl::StatusOr<std::string> accelerators_svg(const nlohmann::ordered_json& accelerators);

}  // namespace tessera::client
