#pragma once

#include "worker/accel/traversal/dependencies.h"
#include "worker/accel/traversal/node_traversal.h"
#include "worker/accel/traversal/queries.h"

// Traversal of a scene's BVHs by one ray, for any query of queries.h.
// accel/reference/plain_traversal.h is a readable version of it; results equal those of
// accel/reference/brute_force.h.

namespace tessera::render::kernels {

/// Offers the hits on one mesh to `query` until it is satisfied; returns whether it is. Skips the
/// triangle with rank `excluded_rank`. Starts at the node or leaf `child`.
template <typename Query>
inline __attribute__((always_inline)) bool intersect_mesh(const MeshBvh<Query::Isa::kWidth>& mesh,
                                                          const ObjectRay& ray,
                                                          std::uint32_t instance,
                                                          std::uint32_t excluded_rank, Query& query,
                                                          std::uint32_t child = kRootNode) {
  const BlockRay block_ray(ray);
  // With spatial splits, the box of a part of a triangle bounds the triangle's t only up to its
  // rounding error, so nodes are culled a little later.
  const float scale = mesh.split ? kLeaveScale : 1, slack = mesh.split ? ray.slack : 0;
  [[maybe_unused]] VisitedTriangles<typename Query::Isa> visited;
  const auto cull = [&] { return std::fma(query.limit, scale, slack); };
  return traverse<Query>(mesh.nodes.data(), mesh.blocks.data(), child, ray, cull(),
                         [&](std::uint32_t index, float& limit) {
                           const TriangleBlock& block = mesh.blocks.data()[index];
                           Query::count_block(block);
                           BlockHits hits;
                           std::uint32_t mask = 0;
                           if constexpr (Query::kMoving) {
                             mask = query.intersect_leaf(block_ray, mesh, index, hits);
                           } else {
                             mask = intersect_block(block_ray, block, query.limit, hits);
                           }
                           for (; mask != 0; mask &= mask - 1) {
                             const int lane = __builtin_ctz(mask);
                             const std::uint32_t rank = block.rank[lane];
                             if (rank == excluded_rank) continue;
                             if constexpr (Query::kVisitOnce) {
                               if (mesh.split && !visited.add(rank)) continue;
                             }
                             if (query.offer(mesh, instance, rank, hits, lane)) return true;
                           }
                           limit = cull();
                           return false;
                         });
}

/// Offers the hits on a solid; defined in solid_traversal.h.
template <typename Query>
bool intersect_solid(const SceneBvh<Query::Isa::kWidth>& scene, const PlacedMesh& placed,
                     const Ray& ray, Query& query);

/// Offers the hits on a placed mesh or solid to `query`; returns whether it is satisfied.
template <typename Query>
__attribute__((noinline)) bool intersect_placed(const SceneBvh<Query::Isa::kWidth>& scene,
                                                const PlacedMesh& placed, const Ray& ray,
                                                Query& query) {
  if constexpr (Query::kSolids) {
    if (placed.solid != kNoSolid) return intersect_solid(scene, placed, ray, query);
  }
  const MeshBvh<Query::Isa::kWidth>& mesh = scene.meshes.data()[placed.mesh];
  Vec3f origin = ray.origin, direction = ray.direction;
  if constexpr (Query::kMoving) {
    if (!query.to_object_space(scene, placed, ray, origin, direction)) return false;
  } else if (!placed.identity) {
    transform_ray(placed.world_to_object, ray.origin, ray.direction, origin, direction);
  }
  ObjectRay object_ray;
  if (!make_object_ray(origin, direction, mesh.bounds, object_ray)) return false;
  const std::uint32_t excluded_rank =
      ray.origin_triangle.instance == placed.instance ? mesh.rank(ray.origin_triangle) : UINT32_MAX;
  return intersect_mesh(mesh, object_ray, placed.instance, excluded_rank, query);
}

/// Offers the hits on the instances at or below the node or leaf `child`. `world_ray` is `ray`
/// prepared for the boxes of the scene.
template <typename Query>
inline __attribute__((always_inline)) bool intersect_instances_below(
    const SceneBvh<Query::Isa::kWidth>& scene, const ObjectRay& world_ray, const Ray& ray,
    std::uint32_t child, Query& query) {
  return traverse<Query>(scene.nodes.data(), scene.placed.data(), child, world_ray, query.limit,
                         [&](std::uint32_t index, float& limit) {
                           const bool satisfied =
                               intersect_placed(scene, scene.placed.data()[index], ray, query);
                           limit = query.limit;
                           return satisfied;
                         });
}

/// Offers the hits on all instances.
template <typename Query>
__attribute__((noinline)) bool intersect_instances(const SceneBvh<Query::Isa::kWidth>& scene,
                                                   const Ray& ray, Query& query) {
  ObjectRay world_ray;
  if (!(max_abs(ray.origin) <= scene.origin_limit) ||
      !make_object_ray(ray.origin, ray.direction, scene.bounds, world_ray)) {
    // The padding of the world boxes does not cover this origin, or the direction is too small for
    // slab tests: visit every instance.
    if (!is_finite(ray.origin) || !is_finite(ray.direction)) return false;
    for (const PlacedMesh& placed : scene.placed) {
      if (intersect_placed(scene, placed, ray, query)) return true;
    }
    return false;
  }
  return intersect_instances_below(scene, world_ray, ray, kRootNode, query);
}

/// Offers the hits on the solids that every ray is tested against. Not inlined, so that scenes
/// without them pay for one comparison only.
template <typename Query>
__attribute__((noinline)) bool intersect_unbounded(const SceneBvh<Query::Isa::kWidth>& scene,
                                                   const Ray& ray, Query& query) {
  for (const PlacedMesh& placed : scene.unbounded) {
    if (intersect_solid(scene, placed, ray, query)) return true;
  }
  return false;
}

/// Offers the hits on a scene.
template <typename Query>
inline bool intersect_scene(const SceneBvh<Query::Isa::kWidth>& scene, const Ray& ray,
                            Query& query) {
  if constexpr (Query::kSolids) {
    if (!scene.unbounded.empty() && intersect_unbounded(scene, ray, query)) [[unlikely]]
      return true;
    if (scene.placed.empty()) return false;
  }
  if (scene.single) return intersect_placed(scene, scene.placed.data()[0], ray, query);
  return intersect_instances(scene, ray, query);
}

template <typename Isa, bool kFiltered>
bool find_closest_hit(const SceneBvh<Isa::kWidth>& scene, const Ray& ray, const HitFilter* filter,
                      Hit& hit) {
  ClosestHit<Isa, kFiltered> query(ray, filter);
  intersect_scene(scene, ray, query);
  return query.result(hit);
}

template <typename Isa, bool kFiltered>
bool find_any_hit(const SceneBvh<Isa::kWidth>& scene, const Ray& ray, const HitFilter* filter) {
  AnyHit<Isa, kFiltered> query(ray, filter);
  return intersect_scene(scene, ray, query);
}

}  // namespace tessera::render::kernels
