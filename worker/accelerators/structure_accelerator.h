#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "worker/accel/accelerator.h"
#include "worker/accel/build/instance_boxes.h"
#include "worker/accel/build/mesh_triangles.h"
#include "worker/accel/solids/solids.h"
#include "worker/accelerators/structures.h"
#include "worker/geometry/motion.h"
#include "worker/scene/scene.h"

namespace tessera::render::accelerators {

/// Finds ray hits in a scene with one index over the triangles of each mesh and another one over
/// the instances, all built by the same Structure. Hits equal those of
/// accel/reference/brute_force.h bit for bit.
class StructureAccelerator final : public Accelerator {
 public:
  /// Copies what it needs, so `scene` need not outlive it. `sample` are rays that end at their
  /// hits, for structures that take rays into account; see record_rays().
  StructureAccelerator(const Scene& scene, const Structure& structure,
                       std::span<const Ray> sample = {});

  /// These add their cost to thread_traversal_counts().
  bool closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const override;
  bool any_hit(const Ray& ray, const HitFilter* filter) const override;
  std::size_t memory_bytes() const override;

  /// Query without a filter and add the cost to `stats`.
  bool closest_hit(const Ray& ray, Hit& hit, TraversalStats& stats) const;
  bool any_hit(const Ray& ray, TraversalStats& stats) const;
  /// Returns all hits with 0 <= t < t_max, ordered as by precedes().
  std::vector<Hit> all_hits(const Ray& ray) const;

 private:
  struct Triangle {
    MovingTriangle corners;
    std::uint32_t primitive, triangle;
  };
  /// A mesh in its object space.
  struct Part {
    std::vector<Triangle> triangles;
    Box3f bounds;
    std::unique_ptr<ShapeIndex> index;  // null without triangles
  };
  struct Placed {
    Affine3d world_to_object;
    std::uint32_t part, instance;
    std::uint32_t solid;           // or kNoSolid
    std::vector<Affine3d> motion;  // object to world by keyframe; empty if it does not move
  };
  /// The scene between two successive keyframes, or the whole scene if nothing moves.
  struct TimeSegment {
    std::vector<Part> parts;
    std::vector<Placed> placed;
    std::vector<std::uint32_t> unbounded;  // in Solids: beside the index
    std::unique_ptr<ShapeIndex> top;       // over `placed`; null if it is empty
    Box3f bounds;                          // of the padded boxes of the placed parts
    float origin_limit = 0;
  };

  static Part make_part(const Mesh& mesh, std::uint32_t segment);
  static std::unique_ptr<ShapeIndex> build_index(const Part& part, bool moves,
                                                 std::span<const Ray> sample,
                                                 const Structure& structure);
  TimeSegment make_segment(const Scene& scene, std::uint32_t segment, const Structure& structure,
                           std::span<const Ray> sample) const;
  void place_instances(const Scene& scene, const InstanceBoxes& instances, TimeSegment& out) const;
  std::vector<std::vector<Ray>> rays_by_part(const TimeSegment& segment,
                                             std::span<const Ray> sample) const;
  std::optional<Ray> in_object_space(const Placed& placed, const Ray& ray) const;
  KeyframePosition keyframe_position(const Ray& ray) const;
  template <typename Offer>
  bool intersect_mesh(const Placed& placed, const Ray& ray, const float& limit, const Offer& offer,
                      TraversalStats& stats) const;
  template <typename Offer>
  bool intersect_solid(std::uint32_t solid, const Ray& ray, const Offer& offer,
                       TraversalStats& stats) const;
  template <typename Offer>
  bool intersect(const Ray& ray, const float& limit, const Offer& offer,
                 TraversalStats& stats) const;
  bool find_closest(const Ray& ray, const HitFilter* filter, Hit& hit, TraversalStats& stats) const;
  std::vector<Hit> find_all(const Ray& ray, TraversalStats& stats) const;

  std::vector<float> key_times_;          // empty if nothing moves
  std::shared_ptr<const Solids> solids_;  // null in a scene without solids
  std::vector<TimeSegment> segments_;
};

}  // namespace tessera::render::accelerators
