#pragma once

#include <memory>
#include <vector>

#include "worker/accel/build/mesh_triangles.h"
#include "worker/accel/accelerator.h"
#include "worker/accelerators/structures.h"
#include "worker/accel/solids/solids.h"
#include "worker/geometry/motion.h"
#include "worker/scene/scene.h"

namespace tessera::render::reference {

/// Ray hits of a scene by a reference structure: one over the triangles of each mesh, and one of
/// the same kind over the instances. Hits have the bits of brute_force.h.
class ReferenceAccel final : public Accelerator {
 public:
  /// Copies what it needs, so the scene may go.
  ReferenceAccel(const Scene& scene, const Structure& structure);

  bool closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const override;
  bool any_hit(const Ray& ray, const HitFilter* filter) const override;
  std::size_t memory_bytes() const override;

  /// The same without a filter, adding what it cost to `work`.
  bool closest_hit(const Ray& ray, Hit& hit, TraversalStats& work) const;
  bool any_hit(const Ray& ray, TraversalStats& work) const;
  /// All hits with 0 <= t < t_max, in the order of "One hit".
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
    std::unique_ptr<ShapeIndex> index;  // null if there is nothing to hit
  };
  struct Placed {
    Affine3d world_to_object;
    std::uint32_t part, instance;
    std::uint32_t solid;           // or kNoSolid
    std::vector<Affine3d> motion;  // object to world by key; empty: it stands still
  };
  /// All of the scene from one key to the next; or at its one time.
  struct TimeSegment {
    std::vector<Part> parts;
    std::vector<Placed> placed;
    std::unique_ptr<ShapeIndex> top;
    Box3f bounds;  // of the padded boxes of the placed parts
    float origin_limit = 0;
  };

  static Part make_part(const Mesh& mesh, std::uint32_t segment, const Structure& structure);
  TimeSegment make_stretch(const Scene& scene, std::uint32_t segment, const Structure& structure) const;
  KeyframePosition place_of(const Ray& ray) const;
  template <typename Take>
  bool meet_mesh(const Placed& placed, const Ray& ray, const float& limit, const Take& take,
                 TraversalStats& work) const;
  template <typename Take>
  bool meet_solid(std::uint32_t solid, const Ray& ray, const Take& take, TraversalStats& work) const;
  template <typename Take>
  bool meet(const Ray& ray, const float& limit, const Take& take, TraversalStats& work) const;
  bool find_closest(const Ray& ray, const HitFilter* filter, Hit& hit, TraversalStats& work) const;

  std::vector<float> key_times_;          // empty if nothing moves
  std::shared_ptr<const Solids> solids_;  // null if there are none
  std::vector<TimeSegment> stretches_;
};

}  // namespace tessera::render::reference
