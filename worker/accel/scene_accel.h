#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "worker/accel/accelerator.h"
#include "worker/accel/binary_bvh/binary_bvh.h"
#include "worker/accel/build/build_quality.h"
#include "worker/accel/build/tree_quality.h"
#include "worker/accel/kernels/kernels.h"
#include "worker/accel/layout/isa.h"
#include "worker/accel/layout/scene_bvh.h"
#include "worker/geometry/ray.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// How the rays of a frame are traced. Hits and pixels do not depend on it.
struct TraceOptions {
  /// Makes the accelerator that replaces SceneAccel's own BVHs.
  using Maker = std::function<std::unique_ptr<const Accelerator>(const Scene&)>;

  // Implicit, because most callers choose only an instruction set.
  // NOLINTNEXTLINE(google-explicit-constructor)
  TraceOptions(Isa instruction_set = best_isa(), Maker accelerator = nullptr)
      : isa(instruction_set), override_accelerator(std::move(accelerator)) {}

  Isa isa;                     // must be supported by the processor
  Maker override_accelerator;  // null: SceneAccel's own BVHs
  /// Features (kFeature... in scene/features.h) that the scene is assumed to have, so that tests
  /// can compare specialised code with the general path. See docs/notes/unused-features.md.
  std::uint64_t assumed_features = 0;
  /// Adds the work of queries to thread_traversal_counts(). The tree is then that of AVX2, whose
  /// nodes have eight children, so that the counts do not depend on `isa`, and rays are not traced
  /// in packets.
  bool counted = false;
};

/// Finds ray hits in a scene with a two-level BVH: one over the instances and one over the
/// triangles of each mesh, which its instances share. Immutable; queries are thread-safe.
///
/// Results equal those of accel/reference/brute_force.h bit for bit, for every ray and instruction
/// set (docs/explanation/determinism.md#closest-hit). A ray misses if its origin or direction is
/// not finite, its direction is zero, or its t_max is not above 0.
///
/// A `filter` is called as bool(const Hit&) for candidate hits, in unspecified order, and returns
/// whether to accept the hit, which must depend on the hit alone. closest_hit offers only hits
/// that precede the best one so far. any_hit offers each triangle of each instance at most once
/// (for the first kMaxTrackedTriangles of an instance), and every hit while the filter returns
/// false, so that a filter can collect them.
class SceneAccel {
 public:
  /// Builds the BVHs with `parallel_for`. Copies what it needs, so `scene` need not outlive it.
  /// Skips triangles that cannot be hit (is_hittable()). Ignores options.override_accelerator.
  ///
  /// If `previous` is given, shares its BVHs of meshes that are in both scenes, and refits its BVH
  /// at the same index for other meshes if refit_mesh_bvh() succeeds.
  SceneAccel(const Scene& scene, const ParallelFor& parallel_for, const TraceOptions& options = {},
             const SceneAccel* previous = nullptr, BuildQuality quality = BuildQuality::normal);
  /// Builds no BVH and forwards all queries to `override_accelerator`.
  explicit SceneAccel(std::unique_ptr<const Accelerator> override_accelerator);

  /// Finds the first hit by (t, instance, primitive, triangle) that the filter accepts.
  template <typename Filter>
  bool closest_hit(const Ray& ray, Hit& hit, Filter&& filter) const {
    if (!valid(ray)) return false;
    const HitFilter call(filter);
    if (route_ == Route::avx512) return avx512::closest_hit(sixteen_, ray, call, hit);
    return route_ == Route::avx2 ? avx2::closest_hit(eight_, ray, call, hit)
                                 : general_closest_hit(ray, &call, hit);
  }
  bool closest_hit(const Ray& ray, Hit& hit) const {
    if (!valid(ray)) return false;
    if (route_ == Route::avx512) return avx512::closest_hit(sixteen_, ray, hit);
    return route_ == Route::avx2 ? avx2::closest_hit(eight_, ray, hit)
                                 : general_closest_hit(ray, nullptr, hit);
  }

  /// Returns whether the filter accepts any hit.
  template <typename Filter>
  bool any_hit(const Ray& ray, Filter&& filter) const {
    if (!valid(ray)) return false;
    const HitFilter call(filter);
    if (route_ == Route::avx512) return avx512::any_hit(sixteen_, ray, call);
    return route_ == Route::avx2 ? avx2::any_hit(eight_, ray, call) : general_any_hit(ray, &call);
  }
  bool any_hit(const Ray& ray) const {
    if (!valid(ray)) return false;
    if (route_ == Route::avx512) return avx512::any_hit(sixteen_, ray);
    return route_ == Route::avx2 ? avx2::any_hit(eight_, ray) : general_any_hit(ray, nullptr);
  }

  /// Returns whether packets of rays can be traced. True in scenes of still meshes, unless queries
  /// are counted or an accelerator overrides the BVHs.
  bool takes_packets() const { return route_ != Route::general; }
  /// Trace up to kPacketSize rays as closest_hit() and any_hit() do, faster if their directions are
  /// similar. Bit i of the result is set if rays[i] hits; hits[i] is then its hit. Require
  /// takes_packets().
  std::uint64_t closest_hits(std::span<const Ray> rays, Hit* hits) const;
  std::uint64_t any_hits(std::span<const Ray> rays) const;

  std::int64_t memory_bytes() const;
  /// Returns the mean over the BVHs of the meshes, weighted by their triangles in all instances.
  TreeQuality tree_quality() const;
  /// Number of meshes whose BVH is shared with `previous`.
  std::size_t shared_meshes() const { return shared_meshes_; }
  /// Number of meshes whose BVH is refitted from `previous`.
  std::size_t refitted_meshes() const { return refitted_meshes_; }

 private:
  template <int kWidth>
  void build(const Scene& scene, SceneBvh<kWidth>& trees, MotionBvh<kWidth>& moving,
             const SceneAccel* previous, const ParallelFor& parallel_for, BuildQuality quality);
  static bool valid(const Ray& ray) { return ray.t_max > 0; }  // the kernels check the rest

  template <int kWidth>
  const SceneBvh<kWidth>& trees() const;
  bool general_closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const;
  bool general_any_hit(const Ray& ray, const HitFilter* filter) const;

  /// The code that answers queries: the kernels for still meshes, or the general path for solids,
  /// motion, counted queries and an override.
  enum class Route : std::uint8_t { avx512, avx2, general };

  Isa isa_;
  bool counted_ = false;
  Route route_;
  std::unique_ptr<const Accelerator> override_;          // answers all queries unless null
  std::vector<SharedArray<Primitive>> mesh_primitives_;  // by mesh; identify shared meshes
  std::size_t shared_meshes_ = 0, refitted_meshes_ = 0;
  SceneBvh<8> eight_;     // filled for avx2
  SceneBvh<16> sixteen_;  // filled for avx512
  MotionBvh<8> eight_moving_;
  MotionBvh<16> sixteen_moving_;
};

}  // namespace tessera::render
