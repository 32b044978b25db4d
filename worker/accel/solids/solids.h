#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "worker/geometry/ray.h"
#include "worker/geometry/shapes/shape.h"
#include "worker/math/transform.h"
#include "worker/scene/scene.h"

namespace tessera::render {

inline constexpr std::uint32_t kNoSolid = UINT32_MAX;

/// A placed shape or mesh that is a solid, or a part of one.
struct Operand {
  Affine3d world_to_object;
  std::uint32_t mesh = 0, instance = 0;
  std::shared_ptr<const Shape> shape;  // null for a mesh
  SharedArray<Primitive> primitives;   // of a mesh
  std::vector<Affine3d> motion;        // object to world by key, if it moves
};

/// A call of a function object that outlives it, which appends all hits with t >= 0 of a ray in the
/// world on the mesh of an operand, in any order: void(const Operand&, const Ray&,
/// std::vector<Hit>&).
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

/// Which hits of a solid are asked for: those up to t, or as far as the first on a curved face.
struct LimitedHits {
  float to = std::numeric_limits<float>::max();
  bool first = false;
};

/// What of a scene is hit as a whole rather than triangle by triangle: its placed shapes and its
/// CSG solids. All structures ask this for hits, so that these agree. Immutable once made.
class Solids {
 public:
  /// Null if the scene has none.
  static std::shared_ptr<const Solids> of(const Scene& scene);

  /// The solid in the place of an instance (of a CSG solid: of its first operand), or kNoSolid.
  std::uint32_t at(std::uint32_t instance) const { return by_instance_[instance]; }

  /// Whether hits beyond the first are much more work, so that they are better asked for apart.
  bool first_is_cheap(std::uint32_t index) const { return solids_[index].first_is_cheap; }

  /// All hits of a ray in the world with t >= 0, whatever its t_max, in the order of "One hit";
  /// without the face that it leaves if that is flat. Both sides of a body are hits; a place where
  /// the ray only touches it is at most one. Those beyond the limit may be left out. Valid until
  /// the next call on this thread.
  std::span<const Hit> hits(std::uint32_t index, const Ray& world_ray, const MeshHits& mesh_hits,
                            const LimitedHits& limited = {}) const;

 private:
  struct Solid {
    std::uint32_t first = 0, count = 0;  // of operands_
    std::vector<CsgStep> steps;          // none: a shape by itself
    bool first_is_cheap = false;
  };

  explicit Solids(const Scene& scene);
  void add(const Scene& scene, std::uint32_t index);

  std::vector<float> key_times_;
  std::vector<Operand> operands_;
  std::vector<Solid> solids_;
  std::vector<std::uint32_t> by_instance_;
};

}  // namespace tessera::render
