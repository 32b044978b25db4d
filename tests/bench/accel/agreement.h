#pragma once

#include <cstdint>

#include "tests/bench/accel/scenes.h"

namespace tessera::render::bench {

/// What a comparison of structures found.
struct Agreement {
  std::int64_t structures = 0;  // and widths
  std::int64_t rays = 0;        // traced by every structure
  std::int64_t brute_rays = 0;  // of those, traced by brute force too
  std::int64_t hits = 0;
  std::int64_t wrong = 0;  // rays for which any two differ in any bit
};

/// How much to compare.
struct AgreementPlan {
  std::int64_t rays = 0;  // with every instruction set this processor has, alone and in packets
  std::int64_t brute_rays = 0;  // the first so many by brute force too
  bool references = false;      // all by each reference structure too
};

/// Traces rays through a scene in which every 16th triangle is there twice: a third of them at
/// random, the others meant to graze, along edges, through vertices, in axis planes. Needs no peer.
Agreement compare_structures(const BenchScene& bench, const AgreementPlan& plan);

}  // namespace tessera::render::bench
