#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>

namespace tessera::render::bench {

/// Measures and prints how the cost of a ray grows: nanoseconds of CPU time per closest hit as a
/// function of the number of triangles of a fractal terrain (10^3 to 10^7; camera rays in packets
/// and single, and scattered rays), and as a function of depth complexity, the number of layers in
/// a view (BVH, brute force and z-buffer; also the nodes and triangles of a ray in the BVH and the
/// fragments of a pixel in the z-buffer). `depth_only` leaves out the first. One thread; `quick`
/// measures small scenes only. Adds to *wrong the differences between the numbers of hits of
/// packets and single rays, and of BVH and brute force.
nlohmann::json measure_growth(bool quick, bool depth_only, std::int64_t* wrong);

}  // namespace tessera::render::bench
