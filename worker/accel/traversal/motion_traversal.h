#pragma once

#include "worker/accel/traversal/dependencies.h"
#include "worker/accel/traversal/solid_traversal.h"

// Traversal of scenes in which something moves during the exposure: solid_traversal.h with meshes
// and transforms interpolated to the ray's time. Compiled into files of its own, so that scenes
// without motion pay nothing for it.

namespace tessera::render::kernels {

/// A query at the time of a ray. Still meshes are used as they are.
template <typename Query>
struct Moving : Query {
  using Isa = typename Query::Isa;
  static constexpr bool kMoving = true;
  float f = 0;  // the ray's time as a fraction of the interval between two keys

  using Query::Query;

  /// intersect_block() for a leaf of the mesh at the ray's time.
  std::uint32_t intersect_leaf(const BlockRay& block_ray, const MeshBvh<Isa::kWidth>& tree,
                               std::uint32_t index, BlockHits& found) const {
    const TriangleBlock& block = tree.blocks.data()[index];
    if (tree.end_blocks.empty()) return intersect_block(block_ray, block, this->limit, found);
    TriangleBlock now;
    lerp_bounded(block, tree.end_blocks.data()[index], f, now);
    return intersect_block(block_ray, now, this->limit, found);
  }

  /// Transforms the ray into the space of a placed mesh at the ray's time; leaves `origin` and
  /// `direction` unchanged for an identity. Returns false if the transform is singular.
  bool to_object_space(const SceneBvh<Isa::kWidth>& scene, const PlacedMesh& placed, const Ray& ray,
                       Vec3f& origin, Vec3f& direction) const {
    if (placed.motion == kNoMotion) {
      if (!placed.identity) {
        transform_ray(placed.world_to_object, ray.origin, ray.direction, origin, direction);
      }
      return true;
    }
    const auto pose = pose_at(scene.motions.data()[placed.motion], {0, f});
    if (!pose) return false;
    if (!is_identity(pose->world_to_object)) {
      transform_ray(pose->world_to_object, ray.origin, ray.direction, origin, direction);
    }
    return true;
  }
};

/// Offers the hits on still objects to `query`, then those on moving objects.
template <typename Query>
bool intersect_still_and_moving(const SceneBvh<Query::Isa::kWidth>& still,
                                const MotionBvh<Query::Isa::kWidth>& moving, const Ray& ray,
                                Moving<Query>& query) {
  const KeyframePosition at = find_key(moving.times, ray.time);
  query.f = at.f;
  return intersect_scene(still, ray, query) ||
         intersect_scene(moving.segments.data()[at.segment], ray, query);
}

template <typename Isa, bool kFiltered>
bool find_closest_hit_moving(const SceneBvh<Isa::kWidth>& still,
                             const MotionBvh<Isa::kWidth>& moving, const Ray& ray,
                             const HitFilter* filter, Hit& hit) {
  Moving<ClosestHitWithSolids<Isa, kFiltered>> query(ray, filter);
  intersect_still_and_moving(still, moving, ray, query);
  return query.result(hit);
}

template <typename Isa, bool kFiltered>
bool find_any_hit_moving(const SceneBvh<Isa::kWidth>& still, const MotionBvh<Isa::kWidth>& moving,
                         const Ray& ray, const HitFilter* filter) {
  Moving<AnyHitWithSolids<Isa, kFiltered>> query(ray, filter);
  return intersect_still_and_moving(still, moving, ray, query);
}

}  // namespace tessera::render::kernels
