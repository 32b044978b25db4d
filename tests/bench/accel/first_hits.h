#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tessera::render::bench {

/// What finds the first hits of a view's pixel centres fastest, printed as it is measured, in
/// million pixels a second of CPU time on one thread: rays along the Hilbert curve, the Morton
/// curve and scanlines, alone and in packets; and an item buffer, a z-buffer of triangle numbers.
/// The share of pixels for which the item buffer names the triangle that rays hit is stated.
/// Adds to *wrong the rays for which packets and single rays, or two orders, find different numbers
/// of hits, and the pixels by which the item buffer agrees on less than kLeastAgreement of them.
nlohmann::json measure_first_hits(const std::vector<std::string>& scenes, bool quick,
                                  std::int64_t* wrong);

}  // namespace tessera::render::bench
