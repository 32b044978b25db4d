#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

namespace tessera::client {

/// Puts the paths the frames were written to into a report, in order.
void name_files(nlohmann::ordered_json& report, const std::vector<std::string>& files);

/// "out.exr: 1280x720, 59.0 M samples, estimated error 0.0123, 12.3 s" of a report, with bound and
/// certainty where an error was asked for (no bound where nothing is claimed); several frames give
/// "out.0000.exr … out.0047.exr" and the largest error.
std::string result_line(const nlohmann::ordered_json& report, double wall_seconds);

/// What a report says against its result: reasons and warnings, a line each but for those that have
/// been said; may be empty.
std::string doubt_lines(const nlohmann::ordered_json& report,
                        std::span<const std::string> said = {});

}  // namespace tessera::client
