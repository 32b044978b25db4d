#pragma once

#include <cstdint>

#include "tests/bench/accel/workload/scenes.h"

namespace tessera::render::bench {

/// Result of comparing the hits of several structures.
struct Agreement {
  std::int64_t structures = 0;  // including variants by instruction set
  std::int64_t rays = 0;        // traced by every structure
  std::int64_t brute_rays = 0;  // traced by brute force as well
  std::int64_t hits = 0;
  std::int64_t wrong = 0;  // rays for which any two structures differ in any bit
};

/// Extent of a comparison.
struct AgreementPlan {
  std::int64_t rays = 0;        // to trace with each instruction set, single and in packets
  std::int64_t brute_rays = 0;  // number of first rays to trace by brute force as well
  bool references = false;      // trace all rays with the structures of worker/accelerators as well
};

/// Traces rays through a scene in which every 16th triangle is duplicated. A third of the rays is
/// random; the others are hard cases: along edges, through vertices, in axis-parallel planes.
Agreement compare_structures(const BenchScene& bench, const AgreementPlan& plan);

}  // namespace tessera::render::bench
