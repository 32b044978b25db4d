#pragma once

#include <cstdint>

#include "tests/bench/accel/scenes.h"

namespace tessera::render::bench {

/// Result of comparing the hits of several structures.
struct Agreement {
  std::int64_t structures = 0;  // including variants by instruction set
  std::int64_t rays = 0;        // traced by every structure
  std::int64_t brute_rays = 0;  // those traced by brute force too
  std::int64_t hits = 0;
  std::int64_t wrong = 0;  // rays for which any two structures differ in any bit
};

/// Extent of a comparison.
struct AgreementPlan {
  std::int64_t rays = 0;        // with each supported instruction set, single and in packets
  std::int64_t brute_rays = 0;  // number of rays, from the first, to trace by brute force too
  bool references = false;      // whether to trace all rays with each structure of accelerators too
};

/// Traces rays through a scene in which every 16th triangle is duplicated. A third of the rays is
/// random; the others are hard cases: along edges, through vertices, in axis-parallel planes.
Agreement compare_structures(const BenchScene& bench, const AgreementPlan& plan);

}  // namespace tessera::render::bench
