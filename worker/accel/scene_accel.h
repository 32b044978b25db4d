#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "worker/accel/layout/scene_bvh.h"
#include "worker/accel/build/binary_bvh.h"
#include "worker/accel/build/build_quality.h"
#include "worker/accel/layout/isa.h"
#include "worker/accel/kernels/kernels.h"
#include "worker/accel/accelerator.h"
#include "worker/accel/build/tree_quality.h"
#include "worker/geometry/ray.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// How the rays of a frame are traced; hits and pixels do not depend on it.
struct TraceOptions {
  /// Makes what answers queries in the place of SceneAccel's own trees.
  using Maker = std::function<std::unique_ptr<const Accelerator>(const Scene&)>;

  // An instruction set alone says it all in most places.
  // NOLINTNEXTLINE(google-explicit-constructor)
  TraceOptions(Isa with = best_isa(), Maker by = nullptr) : isa(with), instead(std::move(by)) {}

  Isa isa;        // supported
  Maker instead;  // null: SceneAccel's own
  /// Features (scene/needs.h) that everything in the scene is taken to have, so that what is chosen
  /// for scenes without can be compared with what is for all: docs/performance.md says which
  /// choices that are.
  std::uint32_t assumed = 0;
};

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
/// the first kMaxShownOnce of an instance), and all of them while the filter returns false, so
/// that it can collect.
class SceneAccel {
 public:
  /// Builds with `parallel_for`; copies what it needs, so the scene may go. Triangles that are
  /// degenerate or have a coordinate that is not finite are left out. `tracing.instead` is the
  /// other constructor's.
  /// Trees of meshes that `before` was built of too, if given, are shared with it, not built again;
  /// others are made from its trees of the same places in the scene where refit_mesh_tree() does.
  SceneAccel(const Scene& scene, const ParallelFor& parallel_for, const TraceOptions& tracing = {},
             const SceneAccel* before = nullptr, BuildQuality quality = BuildQuality::normal);
  /// Builds nothing and leaves all queries to `instead`.
  explicit SceneAccel(std::unique_ptr<const Accelerator> instead);

  /// The first hit over (t, instance, primitive, triangle) that the filter takes.
  template <typename Filter>
  bool closest_hit(const Ray& ray, Hit& hit, Filter&& filter) const {
    if (!valid(ray)) return false;
    const HitFilter call(filter);
    if (route_ == Route::avx512) return avx512::closest_hit(sixteen_, ray, call, hit);
    return route_ == Route::avx2 ? avx2::closest_hit(eight_, ray, call, hit)
                                 : other_closest_hit(ray, &call, hit);
  }
  bool closest_hit(const Ray& ray, Hit& hit) const {
    if (!valid(ray)) return false;
    if (route_ == Route::avx512) return avx512::closest_hit(sixteen_, ray, hit);
    return route_ == Route::avx2 ? avx2::closest_hit(eight_, ray, hit)
                                 : other_closest_hit(ray, nullptr, hit);
  }

  /// Whether the filter takes any hit.
  template <typename Filter>
  bool any_hit(const Ray& ray, Filter&& filter) const {
    if (!valid(ray)) return false;
    const HitFilter call(filter);
    if (route_ == Route::avx512) return avx512::any_hit(sixteen_, ray, call);
    return route_ == Route::avx2 ? avx2::any_hit(eight_, ray, call) : other_any_hit(ray, &call);
  }
  bool any_hit(const Ray& ray) const {
    if (!valid(ray)) return false;
    if (route_ == Route::avx512) return avx512::any_hit(sixteen_, ray);
    return route_ == Route::avx2 ? avx2::any_hit(eight_, ray) : other_any_hit(ray, nullptr);
  }

  /// Whether it can trace rays together: in scenes of meshes that stand still, unless left to
  /// something else.
  bool takes_packets() const { return route_ != Route::other; }
  /// closest_hit and any_hit for up to kPacketSize rays: bit i is set where rays[i] hits, and
  /// hits[i] is its hit. Gains where rays go much the same way. Requires takes_packets().
  std::uint64_t closest_hits(std::span<const Ray> rays, Hit* hits) const;
  std::uint64_t any_hits(std::span<const Ray> rays) const;

  std::int64_t memory_bytes() const;
  /// Of its meshes' trees, a mean weighted by placed triangles.
  TreeQuality tree_quality() const;
  /// How many meshes have the tree of `before`.
  std::size_t shared_meshes() const { return shared_meshes_; }
  /// How many meshes have a tree of `before` with other boxes.
  std::size_t refitted_meshes() const { return refitted_meshes_; }

 private:
  template <int kWidth>
  void build(const Scene& scene, SceneBvh<kWidth>& trees, MotionBvh<kWidth>& moving,
             const SceneAccel* before, const ParallelFor& parallel_for, BuildQuality quality);
  static bool valid(const Ray& ray) { return ray.t_max > 0; }  // the kernels see to the rest

  template <int kWidth>
  const SceneBvh<kWidth>& trees() const;
  bool other_closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const;
  bool other_any_hit(const Ray& ray, const HitFilter* filter) const;

  /// What answers: the kernels for meshes, or what is not worth a branch of theirs.
  enum class Route : std::uint8_t { avx512, avx2, other };

  Isa isa_;
  Route route_;
  std::unique_ptr<const Accelerator> instead_;    // null but where everything is left to it
  std::vector<SharedArray<Primitive>> origins_;  // by mesh: what its tree was built of
  std::size_t shared_meshes_ = 0, refitted_meshes_ = 0;
  SceneBvh<8> eight_;     // filled for avx2
  SceneBvh<16> sixteen_;  // filled for avx512
  MotionBvh<8> eight_moving_;
  MotionBvh<16> sixteen_moving_;
};

}  // namespace tessera::render
