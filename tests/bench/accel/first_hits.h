#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tessera::render::bench {

/// Measures and prints how fast the first hits of a view's pixel centres are found, in million
/// pixels per second of CPU time on one thread: by rays along the Hilbert curve, the Morton curve
/// and scan lines, single and in packets, and by an item buffer, a z-buffer of triangle numbers.
/// Also reports the fraction of pixels for which the item buffer has the triangle that the ray
/// hits. Adds to *wrong the differences between the numbers of hits of packets, single rays and
/// orders, and the number of pixels by which the item buffer falls short of kMinAgreement.
nlohmann::json measure_first_hits(const std::vector<std::string>& scenes, bool quick,
                                  std::int64_t* wrong);

}  // namespace tessera::render::bench
