#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>

namespace tessera::render::bench {

/// Measures and prints how the cost of a ray grows: nanoseconds of CPU time per closest hit as a
/// function of the number of triangles of a fractal terrain (10^3 to 10^7; camera rays in packets
/// and single, and scattered rays), and as a function of depth complexity, the number of layers in
/// a view (BVH and brute force). One thread; `quick` measures small scenes only. Adds to *wrong the
/// differences between the numbers of hits of packets and single rays, and of BVH and brute force.
nlohmann::json measure_growth(bool quick, std::int64_t* wrong);

}  // namespace tessera::render::bench
