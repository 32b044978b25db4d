#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>

namespace tessera::render::bench {

/// How the cost of a ray grows, printed as it is measured: nanoseconds of CPU time per closest hit
/// against the triangles of a fractal terrain (10^3 to 10^7; camera rays in packets and alone, and
/// rays that scattered), and against depth complexity, the layers behind each other in a view
/// (hierarchy beside brute force). One thread; `quick`: small ones only. Adds to *wrong the rays
/// for which packets and single rays, or hierarchy and brute force, find different numbers of hits.
nlohmann::json measure_growth(bool quick, std::int64_t* wrong);

}  // namespace tessera::render::bench
