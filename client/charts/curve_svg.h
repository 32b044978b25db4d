#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace tessera::client {

/// Returns an SVG chart of a report's error curves: error over CPU seconds, both logarithmic, one
/// line per frame, with guides that fall as 1/√n and, if known, the true error. Adapts to light and
/// dark backgrounds. Empty if no frame has an error curve.
std::string curve_svg(const nlohmann::ordered_json& report);

}  // namespace tessera::client
