#pragma once

#include "worker/accel/traversal/dependencies.h"

// Queries that a traversal answers. A query has
//   Isa           the instruction set
//   kOrdered      whether nearer nodes are visited first
//   kVisitOnce    whether each triangle is offered at most once, also in a tree with spatial splits
//   kSolids       whether the scene may have solids; then offer_solid_hit() and has_enough() exist
//   kMoving       whether the scene may move; see motion_traversal.h
//   kCounts       whether the query counts its work; see counted_queries.h
//   count_...()   called for each node visited, block of triangles and solid tested
//   limit         hits with t above it are of no use
//   offer(...)    takes a candidate hit; returns true if the query needs no more of them

namespace tessera::render::kernels {

/// The largest finite float that a query's limit needs for this t_max.
template <typename Isa>
inline float initial_limit(float t_max) {
  return t_max < std::numeric_limits<float>::max() ? t_max : std::numeric_limits<float>::max();
}

/// Base of queries that do not count their work.
struct Uncounted {
  static constexpr bool kCounts = false;
  static void count_node() {}
  static void count_block(const TriangleBlock&) {}
  static void count_solid() {}
};

/// The first hit by (t, instance, rank), among those that the filter accepts.
template <typename IsaType, bool kFiltered>
struct ClosestHit : Uncounted {
  using Isa = IsaType;
  using Mesh = MeshBvh<Isa::kWidth>;
  static constexpr bool kOrdered = true, kVisitOnce = false, kSolids = false, kMoving = false;

  const HitFilter* filter;
  float limit;                           // best t, at most the largest float
  float t;                               // of the best hit, or t_max
  std::uint32_t instance = 0, rank = 0;  // of the best hit; 0, 0 rejects hits at t_max
  float b0 = 0, b1 = 0, b2 = 0;
  const Mesh* mesh = nullptr;  // null: none found

  ClosestHit() = default;
  ClosestHit(const Ray& ray, const HitFilter* hit_filter)
      : filter(hit_filter), limit(initial_limit<Isa>(ray.t_max)), t(ray.t_max) {}

  /// Returns false: a nearer hit may follow.
  template <typename Hits>
  bool offer(const Mesh& hit_mesh, std::uint32_t hit_instance, std::uint32_t hit_rank,
             const Hits& hits, int lane) {
    const float at = hits.t[lane];
    if (at > t) return false;
    if (at == t && (hit_instance > instance || (hit_instance == instance && hit_rank >= rank))) {
      return false;
    }
    if constexpr (kFiltered) {
      const Hit hit = {at, hit_mesh.id(hit_instance, hit_rank), hits.b0[lane], hits.b1[lane],
                       hits.b2[lane]};
      if (!(*filter)(hit)) return false;
    }
    t = limit = at;
    instance = hit_instance;
    rank = hit_rank;
    b0 = hits.b0[lane];
    b1 = hits.b1[lane];
    b2 = hits.b2[lane];
    mesh = &hit_mesh;
    return false;
  }

  /// Stores the best hit; returns false if there is none.
  bool result(Hit& hit) const {
    if (mesh == nullptr) return false;
    hit = {t, mesh->id(instance, rank), b0, b1, b2};
    return true;
  }
};

/// Whether there is a hit that the filter accepts.
template <typename IsaType, bool kFiltered>
struct AnyHit : Uncounted {
  using Isa = IsaType;
  static constexpr bool kOrdered = false, kVisitOnce = kFiltered, kSolids = false, kMoving = false;

  const HitFilter* filter;
  float limit;
  float t_max;

  AnyHit() = default;
  AnyHit(const Ray& ray, const HitFilter* hit_filter)
      : filter(hit_filter), limit(initial_limit<Isa>(ray.t_max)), t_max(ray.t_max) {}

  template <typename Hits>
  bool offer(const MeshBvh<Isa::kWidth>& mesh, std::uint32_t instance, std::uint32_t rank,
             const Hits& hits, int lane) {
    if (!(hits.t[lane] < t_max)) return false;
    if constexpr (kFiltered) {
      return (*filter)(
          {hits.t[lane], mesh.id(instance, rank), hits.b0[lane], hits.b1[lane], hits.b2[lane]});
    }
    return true;
  }
};

/// The triangles of a mesh that a query has been offered, by rank. Keeps the first
/// kMaxTrackedTriangles.
template <typename Isa>
class VisitedTriangles {
 public:
  /// Returns false if the triangle is known to have been added before.
  bool add(std::uint32_t rank) {
    for (int i = 0; i < count_; ++i) {
      if (ranks_[i] == rank) return false;
    }
    if (count_ < kMaxTrackedTriangles) ranks_[count_++] = rank;
    return true;
  }

 private:
  int count_ = 0;
  std::uint32_t ranks_[kMaxTrackedTriangles];
};

}  // namespace tessera::render::kernels
