#pragma once

#include "worker/accel/traversal/dependencies.h"
#include "worker/accel/traversal/packet_rays.h"
#include "worker/accel/traversal/traversal.h"

// Packets: rays of similar direction, one per lane, traverse the BVHs together. Every ray finds the
// hit that it would find alone.
//
// A node is first tested against the packet's frustum, then against its rays in lanes. A subtree
// that fewer than kMinPacketRays rays meet is left to the traversal of single rays.
// Sources: I. Wald et al., "Ray tracing deformable scenes using dynamic bounding volume
// hierarchies", 2007; R. Overbeck, R. Ramamoorthi, W. Mark, "Large ray packets for real-time
// Whitted ray tracing", 2008.

namespace tessera::render::kernels {

/// The bits of a RayMask that belong to the first group of lanes.
template <typename Isa>
inline constexpr RayMask kGroupMask = (RayMask{1} << Isa::kWidth) - 1;

/// The traversal of one BVH by a packet.
template <typename Isa>
class PacketTraversal {
 public:
  using Node = WideNode<Isa::kWidth>;

  /// `active` are the rays that take part.
  PacketTraversal(PacketRays<Isa>& rays, RayMask active)
      : rays_(rays), frustum_(rays), test_(rays, frustum_), active_(active) {}

  const Frustum<Isa>& frustum() const { return frustum_; }
  /// No ray needs a box that it enters after this.
  float farthest() const { return farthest_; }

  /// Calls `leaf(index, rays)` for each leaf that kMinPacketRays or more rays meet, and `few(child,
  /// rays)` for each node or leaf that fewer meet, roughly in the order in which they are met. Both
  /// return the rays that are satisfied, and may lower PacketRays::cull.
  template <typename Leaf, typename Few>
  void run(const Node* nodes, Leaf&& leaf, Few&& few) {
    const Node* node = nodes;
    RayMask mask = active_;
    for (;;) {
      update_farthest();
      push_children(*node, mask);
      for (;;) {
        if (top_ == 0) return;
        const Entry& next = stack_[--top_];
        if (next.enter > farthest_) continue;
        mask = intersect_child(*next.node, next.slot, next.rays & active_);
        if (mask == 0) continue;
        const std::uint32_t child = next.node->children[next.slot];
        const bool is_few = __builtin_popcountll(mask) < kMinPacketRays;
        if (!is_few && (child & kLeafBit) == 0) {
          node = &node_at(nodes, child);
          break;
        }
        active_ &= ~(is_few ? few(child, mask) : leaf(child & ~kLeafBit, mask));
        if (active_ == 0) return;
        update_farthest();
      }
    }
  }

 private:
  struct Entry {
    const Node* node;
    RayMask rays;
    float enter;
    int slot;
  };

  void update_farthest() {
    // Includes satisfied rays, which only loosens the bound: they are few until the end, so masking
    // them out does not pay.
    farthest_ = max_of_rays<Isa>(rays_.cull);
  }

  /// Pushes the children that the frustum meets, the nearest on top.
  void push_children(const Node& node, RayMask mask) {
    typename Isa::Lanes enters;
    std::uint32_t children = test_.intersect(node, farthest_, enters);
    alignas(64) float enter[Isa::kWidth];
    Isa::store(enter, enters);
    const std::size_t base = top_;
    for (; children != 0; children &= children - 1) {
      const int slot = __builtin_ctz(children);
      std::size_t at = top_++;
      for (; at > base && stack_[at - 1].enter < enter[slot]; --at) stack_[at] = stack_[at - 1];
      stack_[at] = {&node, mask, enter[slot], slot};
    }
  }

  /// The rays of `mask` that meet the box of a child.
  RayMask intersect_child(const Node& node, int slot, RayMask mask) const {
    using Lanes = typename Isa::Lanes;
    RayMask out = 0;
    Lanes near[3], far[3];
    for (int k = 0; k < 3; ++k) {
      const auto place = static_cast<std::size_t>(slot);
      near[k] = Isa::splat(node.planes[k][test_.near[k] + place]);
      far[k] = Isa::splat(node.planes[k][Isa::kWidth - test_.near[k] + place]);
    }
    for (int first = 0; first < kPacketSize; first += Isa::kWidth) {
      if ((mask >> first & kGroupMask<Isa>) == 0) continue;
      Lanes enter = Isa::splat(0), leave = Isa::load(rays_.cull + first);
      const Lanes slack = Isa::load(rays_.slack + first) * Isa::splat(kNodeSlackScale);
      for (int k = 0; k < 3; ++k) {
        const Lanes origin = Isa::load(rays_.origin[k] + first);
        const Lanes inverse = Isa::load(rays_.inverse[k] + first);
        enter = Isa::max(enter, (near[k] - origin) * inverse);
        leave = Isa::min(leave, Isa::fused_multiply_add(
                                    far[k] - origin, inverse * Isa::splat(kNodeLeaveScale), slack));
      }
      out |= RayMask{Isa::less_equal_mask(enter, leave)} << first;
    }
    return out & mask;
  }

  PacketRays<Isa>& rays_;
  const Frustum<Isa> frustum_;
  const FrustumTest<Isa> test_;
  RayMask active_;
  float farthest_ = std::numeric_limits<float>::infinity();
  std::size_t top_ = 0;
  Entry stack_[kStackSize<Isa::kWidth>];
};

/// Hits of a group of rays on one triangle, by lane.
template <typename Isa>
struct RayHits {
  alignas(64) float t[Isa::kWidth];
  alignas(64) float b0[Isa::kWidth];
  alignas(64) float b1[Isa::kWidth];
  alignas(64) float b2[Isa::kWidth];
};

/// Tests the group of rays that starts at lane `first` against the triangle in a lane of a block.
/// Returns the rays that intersect_triangle() of geometry/triangle.h accepts with 0 <= t <= limit;
/// their t and barycentrics have the same bits. intersect_block() tests one ray against all
/// triangles of a block in the same way.
template <typename Isa>
inline std::uint32_t intersect_rays(const PacketRays<Isa>& rays, int first,
                                    const TriangleBlock& block, int lane, const float* limits,
                                    RayHits<Isa>& hits) {
  using Lanes = typename Isa::Lanes;
  const float* const triangle = block.v + lane;
  const auto corner = [&](std::size_t vertex, int axis) {
    return Isa::splat(triangle[TriangleBlock::at(vertex, static_cast<std::size_t>(axis))]);
  };
  const Lanes ox = Isa::load(rays.origin[rays.kx] + first),
              oy = Isa::load(rays.origin[rays.ky] + first),
              oz = Isa::load(rays.origin[rays.kz] + first);
  const Lanes sx = Isa::load(rays.sx + first), sy = Isa::load(rays.sy + first);
  const Lanes az = corner(0, rays.kz) - oz, bz = corner(1, rays.kz) - oz,
              cz = corner(2, rays.kz) - oz;
  const Lanes ax = (corner(0, rays.kx) - ox) - sx * az;
  const Lanes ay = (corner(0, rays.ky) - oy) - sy * az;
  const Lanes bx = (corner(1, rays.kx) - ox) - sx * bz;
  const Lanes by = (corner(1, rays.ky) - oy) - sy * bz;
  const Lanes cx = (corner(2, rays.kx) - ox) - sx * cz;
  const Lanes cy = (corner(2, rays.ky) - oy) - sy * cz;
  const Lanes u = Isa::difference_of_products(cx, by, cy, bx);
  const Lanes v = Isa::difference_of_products(ax, cy, ay, cx);
  const Lanes w = Isa::difference_of_products(bx, ay, by, ax);
  const Lanes zero = Isa::splat(0);
  const std::uint32_t same_sign = Isa::less_equal_mask(zero, Isa::min(Isa::min(u, v), w)) |
                                  Isa::less_equal_mask(Isa::max(Isa::max(u, v), w), zero);
  if (same_sign == 0) return 0;
  const Lanes determinant = (u + v) + w;
  const std::uint32_t accepted = same_sign & Isa::not_equal_mask(determinant, zero);
  if (accepted == 0) return 0;
  const Lanes b0 = u / determinant, b1 = v / determinant, b2 = w / determinant;
  const Lanes sz = Isa::load(rays.sz + first);
  Lanes t = (b0 * (sz * az) + b1 * (sz * bz)) + b2 * (sz * cz);
  Lanes enter = Isa::splat(-std::numeric_limits<float>::infinity());
  Lanes leave = Isa::splat(std::numeric_limits<float>::infinity());
  for (int k = 0; k < 3; ++k) {
    const Lanes lo = Isa::min(Isa::min(corner(0, k), corner(1, k)), corner(2, k));
    const Lanes hi = Isa::max(Isa::max(corner(0, k), corner(1, k)), corner(2, k));
    const Lanes origin = Isa::load(rays.origin[k] + first),
                inverse = Isa::load(rays.inverse[k] + first);
    enter = Isa::max(enter, ((rays.backwards[k] ? hi : lo) - origin) * inverse);
    leave = Isa::min(leave, ((rays.backwards[k] ? lo : hi) - origin) * inverse);
  }
  leave = Isa::fused_multiply_add(leave, Isa::splat(kLeaveScale), Isa::load(rays.slack + first));
  t = Isa::min(Isa::max(t, enter), leave);
  Isa::store(hits.t, t);
  Isa::store(hits.b0, b0);
  Isa::store(hits.b1, b1);
  Isa::store(hits.b2, b2);
  return accepted & Isa::less_equal_mask(enter, leave) & Isa::less_equal_mask(zero, t) &
         Isa::less_equal_mask(t, Isa::load(limits + first));
}

/// A packet in the BVH of one mesh.
template <typename Query>
class MeshPacket {
 public:
  using Isa = typename Query::Isa;
  using Mesh = MeshBvh<Isa::kWidth>;

  /// `queries` are those of the rays of the call; `excluded_ranks` holds by lane the rank of the
  /// triangle that the ray skips.
  MeshPacket(const Mesh& mesh, std::uint32_t instance, const RayLanes<Isa>& lanes,
             int direction_class, const std::uint32_t* excluded_ranks, Query* queries)
      : rays_(lanes, direction_class, mesh.bounds),
        mesh_(mesh),
        instance_(instance),
        index_(lanes.index),
        excluded_ranks_(excluded_ranks),
        queries_(queries) {
    for (int i = 0; i < kPacketSize; ++i) {
      limits_[i] = i < rays_.count ? query(i).limit : -1;
      update_cull(i);
    }
  }

  /// Offers the hits on the mesh to the queries; returns the lanes of rays that are satisfied.
  RayMask intersect() {
    PacketTraversal<Isa> traversal(rays_, ~RayMask{0} >> (kPacketSize - rays_.count));
    RayMask all = 0;
    traversal.run(
        mesh_.nodes.data(),
        [&](std::uint32_t index, RayMask mask) {
          const RayMask done = intersect_leaf(traversal, mesh_.blocks.data()[index], mask);
          all |= done;
          return done;
        },
        [&](std::uint32_t child, RayMask mask) {
          RayMask done = 0;
          for (; mask != 0; mask &= mask - 1) {
            const int i = __builtin_ctzll(mask);
            if (intersect_mesh(mesh_, rays_.ray(i), instance_, excluded_ranks_[i], query(i),
                               child)) {
              done |= RayMask{1} << i;
            }
            update_limit(i);
          }
          all |= done;
          return done;
        });
    return all;
  }

 private:
  Query& query(int lane) { return queries_[index_[lane]]; }

  void update_limit(int i) {
    limits_[i] = query(i).limit;
    update_cull(i);
  }
  void update_cull(int i) {
    // As in intersect_mesh().
    rays_.cull[i] = mesh_.split ? std::fma(limits_[i], kLeaveScale, rays_.slack[i]) : limits_[i];
  }

  template <typename Hits>
  bool offer(int i, std::uint32_t rank, const Hits& hits, int lane) {
    if (rank == excluded_ranks_[i]) return false;
    const bool satisfied = query(i).offer(mesh_, instance_, rank, hits, lane);
    update_limit(i);
    return satisfied;
  }

  /// Tests the block ray by ray or triangle by triangle, whichever takes fewer steps.
  RayMask intersect_leaf(const PacketTraversal<Isa>& traversal, const TriangleBlock& block,
                         RayMask mask) {
    const std::uint32_t triangles =
        intersect_frustum(rays_, traversal.frustum(), block, traversal.farthest());
    int groups = 0;
    for (int first = 0; first < kPacketSize; first += Isa::kWidth) {
      groups += (mask >> first & kGroupMask<Isa>) != 0 ? 1 : 0;
    }
    const bool by_ray = __builtin_popcountll(mask) < __builtin_popcount(triangles) * groups;
    return by_ray ? intersect_by_ray(block, mask) : intersect_by_triangle(block, triangles, mask);
  }

  RayMask intersect_by_ray(const TriangleBlock& block, RayMask mask) {
    RayMask done = 0;
    for (; mask != 0; mask &= mask - 1) {
      const int i = __builtin_ctzll(mask);
      const ObjectRay ray = rays_.ray(i);
      BlockHits hits;
      std::uint32_t triangles = intersect_block(BlockRay(ray), block, limits_[i], hits);
      for (; triangles != 0; triangles &= triangles - 1) {
        const int lane = __builtin_ctz(triangles);
        if (!offer(i, block.rank[lane], hits, lane)) continue;
        done |= RayMask{1} << i;
        break;
      }
    }
    return done;
  }

  /// Offers the hits of a triangle to the accepted rays of a group; returns those that are
  /// satisfied.
  RayMask offer_to_rays(int first, std::uint32_t accepted, std::uint32_t rank,
                        const RayHits<Isa>& hits) {
    RayMask done = 0;
    for (; accepted != 0; accepted &= accepted - 1) {
      const int lane = __builtin_ctz(accepted);
      if (offer(first + lane, rank, hits, lane)) done |= RayMask{1} << (first + lane);
    }
    return done;
  }

  RayMask intersect_by_triangle(const TriangleBlock& block, std::uint32_t triangles, RayMask mask) {
    RayMask done = 0;
    for (; triangles != 0; triangles &= triangles - 1) {
      const int triangle = __builtin_ctz(triangles);
      for (int first = 0; first < kPacketSize; first += Isa::kWidth) {
        const auto wanted = static_cast<std::uint32_t>((mask & ~done) >> first & kGroupMask<Isa>);
        if (wanted == 0) continue;
        RayHits<Isa> hits;
        const std::uint32_t accepted =
            wanted & intersect_rays(rays_, first, block, triangle, limits_, hits);
        done |= offer_to_rays(first, accepted, block.rank[triangle], hits);
      }
    }
    return done;
  }

  PacketRays<Isa> rays_;
  alignas(64) float limits_[kPacketSize];
  const Mesh& mesh_;
  const std::uint32_t instance_;
  const std::uint8_t* index_;
  const std::uint32_t* excluded_ranks_;
  Query* queries_;
};

/// Groups rays by direction class: calls `packet(rays, direction_class)` for each class of
/// kMinPacketRays or more, and `one(ray)` with the index of each remaining ray.
template <typename Isa, typename Packet, typename One>
inline void for_each_direction_class(const RayLanes<Isa>& rays, Packet&& packet, One&& one) {
  std::uint8_t classes[kPacketSize];
  RayMask members[kNoDirectionClass + 1] = {};
  RayMask left = 0;
  for (int i = 0; i < rays.count; ++i) {
    const int direction_class = rays.direction_class(i);
    classes[i] = static_cast<std::uint8_t>(direction_class);
    members[direction_class] |= RayMask{1} << i;
    left |= RayMask{1} << i;
  }
  while (left != 0) {
    const int direction_class = classes[__builtin_ctzll(left)];
    RayMask mask = members[direction_class];
    left &= ~mask;
    if (direction_class == kNoDirectionClass || __builtin_popcountll(mask) < kMinPacketRays) {
      for (; mask != 0; mask &= mask - 1) one(rays.index[__builtin_ctzll(mask)]);
    } else if (__builtin_popcountll(mask) == rays.count) {
      packet(rays, direction_class);
    } else {
      RayLanes<Isa> some;
      for (; mask != 0; mask &= mask - 1) some.add_lane(rays, __builtin_ctzll(mask));
      packet(some, direction_class);
    }
  }
}

/// intersect_placed() for the rays of the call in `mask`; returns those that are satisfied.
template <typename Query>
RayMask intersect_placed_packet(const SceneBvh<Query::Isa::kWidth>& scene, const PlacedMesh& placed,
                                std::span<const Ray> rays, RayMask mask, Query* queries) {
  using Isa = typename Query::Isa;
  const MeshBvh<Isa::kWidth>& mesh = scene.meshes.data()[placed.mesh];
  RayLanes<Isa> lanes;
  for (; mask != 0; mask &= mask - 1) {
    const int i = __builtin_ctzll(mask);
    const Ray& ray = rays[static_cast<std::size_t>(i)];
    Vec3f origin = ray.origin, direction = ray.direction;
    if (!placed.identity) {
      transform_ray(placed.world_to_object, ray.origin, ray.direction, origin, direction);
    }
    lanes.add(origin, direction, i);
  }
  RayMask done = 0;
  for_each_direction_class(
      lanes,
      [&](const RayLanes<Isa>& some, int direction_class) {
        std::uint32_t excluded_ranks[kPacketSize];
        for (int i = 0; i < some.count; ++i) {
          const Ray& ray = rays[some.index[i]];
          excluded_ranks[i] = ray.origin_triangle.instance == placed.instance
                                  ? mesh.rank(ray.origin_triangle)
                                  : UINT32_MAX;
        }
        RayMask satisfied =
            MeshPacket<Query>(mesh, placed.instance, some, direction_class, excluded_ranks, queries)
                .intersect();
        for (; satisfied != 0; satisfied &= satisfied - 1) {
          done |= RayMask{1} << some.index[__builtin_ctzll(satisfied)];
        }
      },
      [&](int i) {
        if (intersect_placed(scene, placed, rays[static_cast<std::size_t>(i)], queries[i])) {
          done |= RayMask{1} << i;
        }
      });
  return done;
}

/// intersect_instances() for rays of one direction class whose origins are within the scene's
/// origin_limit; returns the rays of the call that are satisfied.
template <typename Query>
RayMask intersect_instances_packet(const SceneBvh<Query::Isa::kWidth>& scene,
                                   std::span<const Ray> rays,
                                   const RayLanes<typename Query::Isa>& lanes, int direction_class,
                                   Query* queries) {
  using Isa = typename Query::Isa;
  PacketRays<Isa> packet(lanes, direction_class, scene.bounds);
  for (int i = 0; i < kPacketSize; ++i) {
    packet.cull[i] = i < lanes.count ? queries[lanes.index[i]].limit : -1;
  }
  PacketTraversal<Isa> traversal(packet, ~RayMask{0} >> (kPacketSize - lanes.count));
  RayMask all = 0;
  const auto intersect_leaf = [&](std::uint32_t index, RayMask mask) {
    RayMask of_call = 0;
    for (RayMask rest = mask; rest != 0; rest &= rest - 1) {
      of_call |= RayMask{1} << lanes.index[__builtin_ctzll(rest)];
    }
    const RayMask satisfied =
        intersect_placed_packet(scene, scene.placed.data()[index], rays, of_call, queries);
    all |= satisfied;
    RayMask done = 0;
    for (RayMask rest = mask; rest != 0; rest &= rest - 1) {
      const int i = __builtin_ctzll(rest);
      packet.cull[i] = queries[lanes.index[i]].limit;
      done |= (satisfied >> lanes.index[i] & 1) << i;
    }
    return done;
  };
  traversal.run(scene.nodes.data(), intersect_leaf, [&](std::uint32_t child, RayMask mask) {
    RayMask done = 0;
    for (; mask != 0; mask &= mask - 1) {
      const int i = __builtin_ctzll(mask), of_call = lanes.index[i];
      const Ray& ray = rays[static_cast<std::size_t>(of_call)];
      if (intersect_instances_below(scene, packet.ray(i), ray, child, queries[of_call])) {
        done |= RayMask{1} << i;
        all |= RayMask{1} << of_call;
      }
      packet.cull[i] = queries[of_call].limit;
    }
    return done;
  });
  return all;
}

/// intersect_scene() for the rays of a call; returns those that are satisfied.
template <typename Query>
RayMask intersect_scene_packet(const SceneBvh<Query::Isa::kWidth>& scene, std::span<const Ray> rays,
                               Query* queries) {
  using Isa = typename Query::Isa;
  RayMask mask = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    mask |= static_cast<RayMask>(rays[i].t_max > 0 ? 1 : 0) << i;
  }
  if (scene.single) {
    return intersect_placed_packet(scene, scene.placed.data()[0], rays, mask, queries);
  }
  RayLanes<Isa> lanes;
  RayMask done = 0;
  for (; mask != 0; mask &= mask - 1) {
    const int i = __builtin_ctzll(mask);
    const Ray& ray = rays[static_cast<std::size_t>(i)];
    if (max_abs(ray.origin) <= scene.origin_limit) {
      lanes.add(ray.origin, ray.direction, i);
    } else if (intersect_instances(scene, ray, queries[i])) {
      done |= RayMask{1} << i;
    }
  }
  for_each_direction_class(
      lanes,
      [&](const RayLanes<Isa>& some, int direction_class) {
        done |= intersect_instances_packet(scene, rays, some, direction_class, queries);
      },
      [&](int i) {
        if (intersect_instances(scene, rays[static_cast<std::size_t>(i)], queries[i])) {
          done |= RayMask{1} << i;
        }
      });
  return done;
}

template <typename Isa>
inline RayMask find_closest_hits(const SceneBvh<Isa::kWidth>& scene, std::span<const Ray> rays,
                                 Hit* hits) {
  using Query = ClosestHit<Isa, false>;
  Query queries[kPacketSize];
  for (std::size_t i = 0; i < rays.size(); ++i) queries[i] = Query(rays[i], nullptr);
  intersect_scene_packet(scene, rays, queries);
  RayMask found = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    if (queries[i].result(hits[i])) found |= RayMask{1} << i;
  }
  return found;
}

template <typename Isa>
inline RayMask find_any_hits(const SceneBvh<Isa::kWidth>& scene, std::span<const Ray> rays) {
  using Query = AnyHit<Isa, false>;
  Query queries[kPacketSize];
  for (std::size_t i = 0; i < rays.size(); ++i) queries[i] = Query(rays[i], nullptr);
  return intersect_scene_packet(scene, rays, queries);
}

}  // namespace tessera::render::kernels
