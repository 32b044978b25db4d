#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

namespace tessera::client {

/// Sets the paths of the frames in a report, in order.
void name_files(nlohmann::ordered_json& report, const std::vector<std::string>& files);

/// Returns a line such as "out.exr: 1280x720, 59.0 M samples, estimated error 0.0123, 12.3 s". With
/// an error target it includes the certainty and, if certified, the error's bound. For several
/// frames it has "out.0000.exr … out.0047.exr" and the largest error.
std::string result_line(const nlohmann::ordered_json& report, double wall_seconds);

/// Returns the reasons and warnings of a report that are not in `already_printed`, one per line;
/// may be empty.
std::string warning_lines(const nlohmann::ordered_json& report,
                          std::span<const std::string> already_printed = {});

}  // namespace tessera::client
