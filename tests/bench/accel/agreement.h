#pragma once

#include <cstdint>

#include "tests/bench/accel/scenes.h"

namespace tessera::render::bench {

/// What a comparison of structures found.
struct Agreement {
  std::int64_t rays = 0;        // traced by every structure
  std::int64_t brute_rays = 0;  // of those, traced by brute force too
  std::int64_t hits = 0;
  std::int64_t wrong = 0;  // rays for which any two differ in any bit
};

/// Traces `rays` rays with every instruction set this processor has, and the first `brute_rays` by
/// brute force: a third at random, the others meant to graze, along edges, through vertices, in
/// axis planes. Needs no peer.
Agreement compare_structures(const BenchScene& bench, std::int64_t rays, std::int64_t brute_rays);

}  // namespace tessera::render::bench
