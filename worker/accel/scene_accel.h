#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "worker/accel/traverse.h"
#include "worker/accel/triangle_block.h"
#include "worker/accel/wide_bvh.h"
#include "worker/geometry/ray.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A filter for closest_hit and any_hit that takes every hit; costs nothing.
struct AcceptAll {
  bool operator()(const Hit&) const { return true; }
};

/// Finds ray hits in a scene: a BVH over instances, and one over the triangles of each mesh that
/// instances share. Immutable once made; any number of threads may ask at once.
///
/// "One hit" (design.md): results equal those of accel/brute_force.h bit for bit, whatever the
/// ray. A ray whose origin or direction is not finite, whose direction is zero, or whose t_max is
/// not above 0 misses at once.
///
/// A `filter` is called as bool(const Hit&) for hits that would otherwise be taken, in no order
/// that may matter: what it returns must depend on the hit alone. For closest_hit only hits
/// before the best so far are shown. any_hit shows each triangle of each instance at most once,
/// and all of them while the filter returns false, so that it can collect.
class SceneAccel {
 public:
  /// Builds with `parallel_for`; copies what it needs, so the scene may go. Triangles that are
  /// degenerate or have a coordinate that is not finite are left out.
  SceneAccel(const Scene& scene, const ParallelFor& parallel_for);

  /// The first hit over (t, instance, primitive, triangle) that the filter takes.
  template <typename Filter>
  bool closest_hit(const Ray& ray, Hit& hit, Filter&& filter) const;
  bool closest_hit(const Ray& ray, Hit& hit) const;

  /// Whether the filter takes any hit.
  template <typename Filter>
  bool any_hit(const Ray& ray, Filter&& filter) const;
  bool any_hit(const Ray& ray) const;

  std::int64_t memory_bytes() const;

 private:
  struct MeshTree {
    std::vector<WideNode> nodes;
    std::vector<TriangleBlock> blocks;  // one a leaf
    Box3f bounds;
  };
  struct PlacedMesh {
    Affine3d world_to_object;
    std::uint32_t mesh = 0, instance = 0;
    bool identity = false;
  };

  static MeshTree build_mesh(const Mesh& mesh, const ParallelFor& parallel_for);
  void build_top(const Scene& scene, const ParallelFor& parallel_for);
  static bool valid(const Ray& ray) {
    return is_finite(ray.origin) && is_finite(ray.direction) && max_abs(ray.direction) > 0 &&
           ray.t_max > 0;
  }

  /// Calls take(hit) for triangles of one instance that the ray's line meets at 0 <= t, until it
  /// returns true; `limit` culls.
  template <typename Take>
  bool meet_instance(const PlacedMesh& placed, const Ray& ray, const float& limit,
                     Take&& take) const;
  /// The same for all instances.
  template <typename Take>
  bool meet_all(const Ray& ray, const float& limit, Take&& take) const;

  std::vector<MeshTree> meshes_;
  std::vector<PlacedMesh> placed_;  // in leaf order of nodes_
  std::vector<WideNode> nodes_;
  Box3f bounds_;            // of the padded instance boxes
  float origin_limit_ = 0;  // the pads hold for origins within this, per axis
};

template <typename Take>
bool SceneAccel::meet_instance(const PlacedMesh& placed, const Ray& ray, const float& limit,
                               Take&& take) const {
  const MeshTree& mesh = meshes_[placed.mesh];
  Vec3f origin = ray.origin, direction = ray.direction;
  if (!placed.identity) {
    transform_ray(placed.world_to_object, ray.origin, ray.direction, origin, direction);
  }
  ObjectRay object_ray;
  if (!make_object_ray(origin, direction, mesh.bounds, object_ray)) return false;
  const auto leaf = [&](std::uint32_t index) {
    const TriangleBlock& block = mesh.blocks[index];
    BlockHits hits;
    for (std::uint32_t met = intersect_block(object_ray, block, hits); met != 0; met &= met - 1) {
      const auto lane = static_cast<std::size_t>(__builtin_ctz(met));
      if (!(hits.t[lane] >= 0)) continue;
      const TriangleId id = {placed.instance, block.primitive[lane], block.triangle[lane]};
      if (id == ray.leaves) continue;
      if (take(Hit{hits.t[lane], id, hits.b0[lane], hits.b1[lane], hits.b2[lane]})) return true;
    }
    return false;
  };
  return traverse(mesh.nodes.data(), object_ray, limit, leaf, [] {});
}

template <typename Take>
bool SceneAccel::meet_all(const Ray& ray, const float& limit, Take&& take) const {
  ObjectRay world_ray;
  if (!(max_abs(ray.origin) <= origin_limit_) ||
      !make_object_ray(ray.origin, ray.direction, bounds_, world_ray)) {
    // Too far for the pads, or a direction too small for slabs: no culling by world boxes.
    for (const PlacedMesh& placed : placed_) {
      if (meet_instance(placed, ray, limit, take)) return true;
    }
    return false;
  }
  const auto leaf = [&](std::uint32_t index) {
    return meet_instance(placed_[index], ray, limit, take);
  };
  return traverse(nodes_.data(), world_ray, limit, leaf, [] {});
}

template <typename Filter>
bool SceneAccel::closest_hit(const Ray& ray, Hit& hit, Filter&& filter) const {
  if (!valid(ray)) return false;
  Hit best;
  best.t = ray.t_max;
  best.id = {0, 0, 0};  // nothing precedes it at t_max
  bool found = false;
  constexpr float kLargest = std::numeric_limits<float>::max();
  float limit = ray.t_max < kLargest ? ray.t_max : kLargest;
  meet_all(ray, limit, [&](const Hit& candidate) {
    if (!precedes(candidate, best) || !filter(candidate)) return false;
    best = candidate;
    found = true;
    limit = best.t;
    return false;
  });
  if (found) hit = best;
  return found;
}

template <typename Filter>
bool SceneAccel::any_hit(const Ray& ray, Filter&& filter) const {
  if (!valid(ray)) return false;
  constexpr float kLargest = std::numeric_limits<float>::max();
  const float limit = ray.t_max < kLargest ? ray.t_max : kLargest;
  return meet_all(ray, limit, [&](const Hit& candidate) {
    return candidate.t < ray.t_max && filter(candidate);
  });
}

}  // namespace tessera::render
