#pragma once

#include "worker/accel/traversal/dependencies.h"
#include "worker/accel/traversal/motion_traversal.h"
#include "worker/accel/traversal/thread_counts.h"

// Queries that count the work of their traversal. Compiled into a file of its own, so that other
// queries pay nothing for it.

namespace tessera::render::kernels {

/// A query that adds its work to thread_traversal_counts().
template <typename Query>
struct Counted : Query {
  static constexpr bool kCounts = true;

  using Query::Query;

  static void count_node() { ++thread_traversal_counts().nodes; }
  static void count_block(const TriangleBlock& block) {
    for (std::size_t lane = 0; lane < kBlockSize; ++lane) {
      thread_traversal_counts().primitives += block.has_triangle(lane) ? 1 : 0;
    }
  }
  static void count_solid() { ++thread_traversal_counts().primitives; }
};

/// Offers the hits of any scene to a query that counts.
template <typename Query>
bool intersect_counted(const SceneBvh<Query::Isa::kWidth>& still,
                       const MotionBvh<Query::Isa::kWidth>& moving, const Ray& ray,
                       Moving<Counted<Query>>& query) {
  ++thread_traversal_counts().rays;
  if (!moving.times.empty()) return intersect_still_and_moving(still, moving, ray, query);
  return intersect_scene(still, ray, static_cast<Counted<Query>&>(query));
}

}  // namespace tessera::render::kernels
