#pragma once

#include <cstdint>
#include <utility>
#include <variant>
#include <vector>

#include "worker/accel/accel_trees.h"
#include "worker/accel/binary_bvh.h"
#include "worker/accel/isa.h"
#include "worker/accel/kernels.h"
#include "worker/geometry/ray.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Finds ray hits in a scene: a BVH over instances, and one over the triangles of each mesh that
/// instances share. Immutable once made; any number of threads may ask at once.
///
/// "One hit" (design.md): results equal those of accel/brute_force.h bit for bit, whatever the ray
/// and the instruction set. A ray whose origin or direction is not finite, whose direction is zero,
/// or whose t_max is not above 0 misses at once.
///
/// A `filter` is called as bool(const Hit&) for hits that would otherwise be taken, in no order
/// that may matter: what it returns must depend on the hit alone. For closest_hit only hits
/// before the best so far are shown. any_hit shows each triangle of each instance at most once (of
/// the first kMostShownOnce of an instance), and all of them while the filter returns false, so
/// that it can collect.
class SceneAccel {
 public:
  /// Builds with `parallel_for`; copies what it needs, so the scene may go. Triangles that are
  /// degenerate or have a coordinate that is not finite are left out. Requires a supported `isa`.
  /// Trees of meshes that `before` was built of too, if given, are shared with it, not built again.
  SceneAccel(const Scene& scene, const ParallelFor& parallel_for, Isa isa = best_isa(),
             const SceneAccel* before = nullptr);

  /// The first hit over (t, instance, primitive, triangle) that the filter takes.
  template <typename Filter>
  bool closest_hit(const Ray& ray, Hit& hit, Filter&& filter) const {
    if (!valid(ray)) return false;
    const HitFilter call(filter);
    return isa_ == Isa::avx512 ? avx512::closest_hit(sixteen_, ray, call, hit)
                               : avx2::closest_hit(eight_, ray, call, hit);
  }
  bool closest_hit(const Ray& ray, Hit& hit) const {
    if (!valid(ray)) return false;
    return isa_ == Isa::avx512 ? avx512::closest_hit(sixteen_, ray, hit)
                               : avx2::closest_hit(eight_, ray, hit);
  }

  /// Whether the filter takes any hit.
  template <typename Filter>
  bool any_hit(const Ray& ray, Filter&& filter) const {
    if (!valid(ray)) return false;
    const HitFilter call(filter);
    return isa_ == Isa::avx512 ? avx512::any_hit(sixteen_, ray, call)
                               : avx2::any_hit(eight_, ray, call);
  }
  bool any_hit(const Ray& ray) const {
    if (!valid(ray)) return false;
    return isa_ == Isa::avx512 ? avx512::any_hit(sixteen_, ray) : avx2::any_hit(eight_, ray);
  }

  std::int64_t memory_bytes() const;
  /// How many meshes have the tree of `before`.
  std::size_t shared_meshes() const { return shared_meshes_; }

 private:
  template <int kWidth>
  void build(const Scene& scene, AccelTrees<kWidth>& trees, const SceneAccel* before,
             const ParallelFor& parallel_for);
  static bool valid(const Ray& ray) { return ray.t_max > 0; }  // the kernels see to the rest

  template <int kWidth>
  const AccelTrees<kWidth>& trees() const;

  Isa isa_;
  std::vector<SharedArray<Primitive>> origins_;  // by mesh: what its tree was built of
  std::size_t shared_meshes_ = 0;
  AccelTrees<8> eight_;     // filled for avx2
  AccelTrees<16> sixteen_;  // filled for avx512
};

}  // namespace tessera::render
