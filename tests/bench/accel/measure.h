#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>

#include "tests/support/cpu_seconds.h"
#include "worker/accel/scene_accel.h"

namespace tessera::render::bench {

using tessera::testing::cpu_seconds;

/// Returns the mean CPU seconds of `runs` calls of `run`. Sets *hits to the result of the last
/// call.
template <typename Run>
double timed(Run&& run, std::size_t runs, std::int64_t* hits) {
  const double start = cpu_seconds();
  for (std::size_t i = 0; i < runs; ++i) *hits = run();
  return (cpu_seconds() - start) / static_cast<double>(runs);
}

/// Traces rays one by one and returns the number of hits.
inline std::int64_t closest_hits(const SceneAccel& accel, std::span<const Ray> rays) {
  std::int64_t hits = 0;
  for (const Ray& ray : rays) {
    Hit hit;
    hits += accel.closest_hit(ray, hit) ? 1 : 0;
  }
  return hits;
}

inline std::int64_t any_hits(const SceneAccel& accel, std::span<const Ray> rays) {
  std::int64_t hits = 0;
  for (const Ray& ray : rays) hits += accel.any_hit(ray) ? 1 : 0;
  return hits;
}

/// Traces rays in packets and returns the number of hits.
inline std::int64_t closest_in_packets(const SceneAccel& accel, std::span<const Ray> rays) {
  std::int64_t found = 0;
  for (std::size_t first = 0; first < rays.size(); first += kPacketSize) {
    Hit hits[kPacketSize];
    found += std::popcount(accel.closest_hits(
        rays.subspan(first, std::min<std::size_t>(kPacketSize, rays.size() - first)), hits));
  }
  return found;
}

inline std::int64_t any_in_packets(const SceneAccel& accel, std::span<const Ray> rays) {
  std::int64_t found = 0;
  for (std::size_t first = 0; first < rays.size(); first += kPacketSize) {
    found += std::popcount(accel.any_hits(
        rays.subspan(first, std::min<std::size_t>(kPacketSize, rays.size() - first))));
  }
  return found;
}

}  // namespace tessera::render::bench
