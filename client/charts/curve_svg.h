#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace tessera::client {

/// Draws a report's error curves as SVG: error against CPU seconds, both logarithmic, a line a
/// frame, with guides that fall as 1/√n, and the true error beside the estimate where the report
/// has it. Readable on light and dark ground. Empty if no frame has a curve with an error.
std::string curve_svg(const nlohmann::ordered_json& report);

}  // namespace tessera::client
