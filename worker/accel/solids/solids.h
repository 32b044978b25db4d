#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "worker/geometry/ray.h"
#include "worker/geometry/shape.h"
#include "worker/math/transform.h"
#include "worker/scene/scene.h"

namespace tessera::render {

inline constexpr std::uint32_t kNoSolid = UINT32_MAX;

/// A placed shape or mesh that is a solid or an operand of one.
struct Operand {
  Affine3d world_to_object;
  std::uint32_t mesh = 0, instance = 0;
  std::shared_ptr<const Shape> shape;  // null for a mesh
  SharedArray<Primitive> primitives;   // of a mesh
  std::vector<Affine3d> motion;        // object to world by keyframe, if it moves
};

/// Vertices of a triangle of a mesh, object space.
inline std::array<Vec3f, 3> triangle_of(const Operand& mesh, const TriangleId& id) {
  const Primitive& primitive = mesh.primitives[id.primitive];
  const auto& [i0, i1, i2] = primitive.triangles[id.triangle];
  return {primitive.positions[i0], primitive.positions[i1], primitive.positions[i2]};
}

/// Non-owning reference to a function object void(const Operand&, const Ray&, std::vector<Hit>&),
/// which must outlive it. The function appends all hits with t >= 0 of a world-space ray on the
/// mesh of an operand, in any order.
class MeshHits {
 public:
  template <typename Collect>
  explicit MeshHits(Collect& collect)
      : collect_(const_cast<void*>(static_cast<const void*>(&collect))),
        call_([](void* f, const Operand& operand, const Ray& ray, std::vector<Hit>& hits) {
          (*static_cast<Collect*>(f))(operand, ray, hits);
        }) {}

  void operator()(const Operand& operand, const Ray& ray, std::vector<Hit>& hits) const {
    call_(collect_, operand, ray, hits);
  }

 private:
  void* collect_;
  void (*call_)(void*, const Operand&, const Ray&, std::vector<Hit>&);
};

/// Limits the hits on a solid to those that a caller needs: those with t <= t_max and, with
/// `first_only`, none after the first on a curved face.
struct HitLimits {
  float t_max = std::numeric_limits<float>::max();
  bool first_only = false;
};

/// The placed shapes and CSG solids of a scene, which are intersected as a whole instead of
/// triangle by triangle. All acceleration structures use this class, so that their hits agree.
/// Immutable.
class Solids {
 public:
  /// Returns null if the scene has no solids.
  static std::shared_ptr<const Solids> of(const Scene& scene);

  /// Returns the solid that replaces an instance, or kNoSolid. A CSG solid replaces its first
  /// operand.
  std::uint32_t at(std::uint32_t instance) const { return by_instance_[instance]; }

  /// Returns whether the first hit is much cheaper to find than all hits, so that callers should
  /// request it alone.
  bool first_is_cheap(std::uint32_t index) const { return solids_[index].first_is_cheap; }

  /// Returns all hits of a world-space ray with t >= 0, whatever its t_max, ordered as by
  /// precedes(). Omits the flat face on which the ray starts. Both entries and exits are hits; a
  /// point where the ray touches the surface is at most one hit. Hits outside the limits may be
  /// missing. The result is valid until the next call on this thread.
  std::span<const Hit> hits(std::uint32_t index, const Ray& world_ray, const MeshHits& mesh_hits,
                            const HitLimits& limits = {}) const;

 private:
  struct Solid {
    std::uint32_t first = 0, count = 0;  // of operands_
    std::vector<CsgStep> steps;          // empty for a single shape
    bool first_is_cheap = false;
  };

  explicit Solids(const Scene& scene);
  void add(const Scene& scene, std::uint32_t index);

  Vec3d recentring_;  // Scene::center
  std::vector<float> key_times_;
  std::vector<Operand> operands_;
  std::vector<Solid> solids_;
  std::vector<std::uint32_t> by_instance_;
};

}  // namespace tessera::render
