#pragma once

#include "worker/accel/traversal/dependencies.h"
#include "worker/accel/traversal/traversal.h"

// Traversal of scenes with solids (shapes and CSG): traversal.h with queries that take hits on
// solids too. Compiled into files of its own, so that scenes without solids pay nothing for it.

namespace tessera::render::kernels {

/// ClosestHit in a scene with solids.
template <typename IsaType, bool kFiltered>
struct ClosestHitWithSolids : ClosestHit<IsaType, kFiltered> {
  static constexpr bool kSolids = true;
  bool found_solid = false;
  Hit solid_hit;  // the best hit, if found_solid and `mesh` is null

  using ClosestHit<IsaType, kFiltered>::ClosestHit;

  bool is_solid() const { return found_solid && this->mesh == nullptr; }

  /// Stores the best hit; returns false if there is none.
  bool result(Hit& hit) const {
    if (is_solid()) {
      hit = solid_hit;
      return true;
    }
    return ClosestHit<IsaType, kFiltered>::result(hit);
  }

  /// Whether all hits behind this one, on the same solid, are of no use.
  bool has_enough(const Hit& hit) const {
    return hit.t > this->t || (is_solid() && solid_hit.id == hit.id && solid_hit.t == hit.t);
  }

  /// Returns false: a nearer hit may follow.
  bool offer_solid_hit(const Hit& hit) {
    if (hit.t > this->t) return false;
    if (hit.t == this->t &&
        (is_solid() ? hit.id >= solid_hit.id : hit.id.instance >= this->instance)) {
      return false;
    }
    if constexpr (kFiltered) {
      if (!(*this->filter)(hit)) return false;
    }
    this->t = this->limit = hit.t;
    this->instance = hit.id.instance;
    this->mesh = nullptr;
    found_solid = true;
    solid_hit = hit;
    return false;
  }
};

/// AnyHit in a scene with solids.
template <typename IsaType, bool kFiltered>
struct AnyHitWithSolids : AnyHit<IsaType, kFiltered> {
  static constexpr bool kSolids = true;

  using AnyHit<IsaType, kFiltered>::AnyHit;

  bool has_enough(const Hit& hit) const { return !(hit.t < this->t_max); }

  bool offer_solid_hit(const Hit& hit) {
    if (!(hit.t < this->t_max)) return false;
    if constexpr (kFiltered) return (*this->filter)(hit);
    return true;
  }
};

/// Collects all hits on the mesh of a CSG operand, whatever the ray's t_max.
template <typename IsaType>
struct CollectHits : Uncounted {
  using Isa = IsaType;
  static constexpr bool kOrdered = false, kVisitOnce = true, kSolids = false, kMoving = false;

  explicit CollectHits(std::vector<Hit>& to) : hits(to) {}

  std::vector<Hit>& hits;
  float limit = std::numeric_limits<float>::max();

  bool offer(const MeshBvh<Isa::kWidth>& mesh, std::uint32_t instance, std::uint32_t rank,
             const BlockHits& found, int lane) {
    hits.push_back(
        {found.t[lane], mesh.id(instance, rank), found.b0[lane], found.b1[lane], found.b2[lane]});
    return false;
  }
};

/// A query at a moving ray's time; defined in motion_traversal.h.
template <typename Query>
struct Moving;

/// A query that counts its work; defined in counted_queries.h.
template <typename Query>
struct Counted;

/// CollectHits for the operands of a solid that `Query` meets.
template <typename Query,
          typename Collect =
              std::conditional_t<Query::kCounts, Counted<CollectHits<typename Query::Isa>>,
                                 CollectHits<typename Query::Isa>>>
using CollectHitsFor = std::conditional_t<Query::kMoving, Moving<Collect>, Collect>;

template <typename Query>
bool intersect_solid(const SceneBvh<Query::Isa::kWidth>& scene, const PlacedMesh& placed,
                     const Ray& ray, Query& query) {
  const auto collect = [&](const Operand& operand, const Ray& operand_ray, std::vector<Hit>& hits) {
    CollectHitsFor<Query> all{hits};
    if constexpr (Query::kMoving) all.f = query.f;
    intersect_placed(scene,
                     {operand.world_to_object, operand.mesh, operand.instance,
                      is_identity(operand.world_to_object), kNoSolid},
                     operand_ray, all);
  };
  // Requests only the first hit if that is cheap; if the query rejects it, requests all hits and
  // skips those already offered.
  Query::count_solid();
  HitLimits limits = {query.limit, scene.solids->first_is_cheap(placed.solid)};
  std::size_t offered = 0;
  for (;;) {
    const auto hits = scene.solids->hits(placed.solid, ray, MeshHits(collect), limits);
    for (const Hit& hit : hits.subspan(offered)) {
      if (query.offer_solid_hit(hit)) return true;
    }
    if (!limits.first_only || hits.empty() || query.has_enough(hits.back())) return false;
    offered = hits.size();
    limits.first_only = false;
  }
}

template <typename Isa, bool kFiltered>
bool find_closest_hit_with_solids(const SceneBvh<Isa::kWidth>& scene, const Ray& ray,
                                  const HitFilter* filter, Hit& hit) {
  ClosestHitWithSolids<Isa, kFiltered> query(ray, filter);
  intersect_scene(scene, ray, query);
  return query.result(hit);
}

template <typename Isa, bool kFiltered>
bool find_any_hit_with_solids(const SceneBvh<Isa::kWidth>& scene, const Ray& ray,
                              const HitFilter* filter) {
  AnyHitWithSolids<Isa, kFiltered> query(ray, filter);
  return intersect_scene(scene, ray, query);
}

}  // namespace tessera::render::kernels
