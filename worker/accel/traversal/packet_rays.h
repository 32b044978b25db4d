#pragma once

#include "worker/accel/traversal/dependencies.h"
#include "worker/accel/traversal/node_traversal.h"

// The rays of a packet, one per lane, and their common bounds.
//
// Bounds of the rays' origins and inverse directions form a frustum that is tested before any
// single ray. Each step of the slab test rounds monotonically, so bounds of its inputs give bounds
// of its results, rounding included.

namespace tessera::render::kernels {

using RayMask = std::uint64_t;  // one bit per ray of a packet
static_assert(kPacketSize == 64);

/// Fewer rays than this are traced one by one. Measured: docs/notes/rays-against-embree.md.
inline constexpr int kMinPacketRays = 8;

/// Direction class of rays that no packet takes.
inline constexpr int kNoDirectionClass = 24;

/// Origins and directions of up to kPacketSize rays in one space, by lane.
template <typename Isa>
struct RayLanes {
  int count = 0;
  alignas(64) float origin[3][kPacketSize];
  alignas(64) float direction[3][kPacketSize];
  std::uint8_t index[kPacketSize];  // of the ray in the call

  void add(const Vec3f& o, const Vec3f& d, int ray) {
    for (int k = 0; k < 3; ++k) {
      origin[k][count] = o[k];
      direction[k][count] = d[k];
    }
    index[count++] = static_cast<std::uint8_t>(ray);
  }
  void add_lane(const RayLanes& from, int i) {
    add({from.origin[0][i], from.origin[1][i], from.origin[2][i]},
        {from.direction[0][i], from.direction[1][i], from.direction[2][i]}, from.index[i]);
  }

  /// The property that the rays of a packet share: the axis of the largest direction component,
  /// times eight, plus the signs of the components; or kNoDirectionClass.
  int direction_class(int i) const {
    const Vec3f o = {origin[0][i], origin[1][i], origin[2][i]};
    const Vec3f d = {direction[0][i], direction[1][i], direction[2][i]};
    const Vec3f size = {std::fabs(d.x), std::fabs(d.y), std::fabs(d.z)};
    constexpr float kSmall = std::numeric_limits<float>::min(),
                    kInf = std::numeric_limits<float>::infinity();
    // Inverses must be finite, so that no product is NaN.
    const bool usable = size.x >= kSmall && size.y >= kSmall && size.z >= kSmall && size.x < kInf &&
                        size.y < kInf && size.z < kInf && std::fabs(o.x) < kInf &&
                        std::fabs(o.y) < kInf && std::fabs(o.z) < kInf;
    if (!usable) return kNoDirectionClass;
    const int signs =
        (std::signbit(d.x) ? 1 : 0) | (std::signbit(d.y) ? 2 : 0) | (std::signbit(d.z) ? 4 : 0);
    return 8 * largest_axis(size) + signs;
  }
};

/// An ObjectRay per lane, all of one direction class.
template <typename Isa>
struct PacketRays {
  int count;
  int kx, ky, kz;
  bool backwards[3];
  alignas(64) float origin[3][kPacketSize];
  alignas(64) float inverse[3][kPacketSize];
  alignas(64) float sx[kPacketSize], sy[kPacketSize], sz[kPacketSize];
  alignas(64) float slack[kPacketSize];
  alignas(64) float cull[kPacketSize];  // boxes entered after this are of no use to the ray

  /// Leaves `cull` uninitialized. Lanes beyond the last ray repeat the first. Requires a ray.
  PacketRays(const RayLanes<Isa>& rays, int direction_class, const Box3f& bounds)
      : count(rays.count) {
    assert(count > 0);
    kz = direction_class / 8;
    kx = kz == 2 ? 0 : kz + 1;
    ky = kx == 2 ? 0 : kx + 1;
    for (int k = 0; k < 3; ++k) backwards[k] = (direction_class >> k & 1) != 0;
    alignas(64) float direction[3][kPacketSize];
    for (int k = 0; k < 3; ++k) {
      for (int i = 0; i < kPacketSize; ++i) {
        origin[k][i] = i < count ? rays.origin[k][i] : rays.origin[k][0];
        direction[k][i] = i < count ? rays.direction[k][i] : rays.direction[k][0];
      }
      for (int i = 0; i < kPacketSize; ++i) inverse[k][i] = 1 / direction[k][i];
    }
    const float lo = bounds.lo[kz], hi = bounds.hi[kz];
    for (int i = 0; i < kPacketSize; ++i) {  // as make_object_ray()
      sx[i] = direction[kx][i] / direction[kz][i];
      sy[i] = direction[ky][i] / direction[kz][i];
      sz[i] = 1 / direction[kz][i];
      const float to_lo = std::fabs((lo - origin[kz][i]) * sz[i]);
      const float to_hi = std::fabs((hi - origin[kz][i]) * sz[i]);
      slack[i] = kSlackScale * (to_lo > to_hi ? to_lo : to_hi);
    }
  }

  ObjectRay ray(int i) const {
    ObjectRay out;
    out.origin = {origin[0][i], origin[1][i], origin[2][i]};
    out.inverse = {inverse[0][i], inverse[1][i], inverse[2][i]};
    for (std::size_t k = 0; k < 3; ++k) out.backwards[k] = backwards[k] ? 1 : 0;
    out.kx = static_cast<std::uint8_t>(kx);
    out.ky = static_cast<std::uint8_t>(ky);
    out.kz = static_cast<std::uint8_t>(kz);
    out.sx = sx[i];
    out.sy = sy[i];
    out.sz = sz[i];
    out.slack = slack[i];
    return out;
  }
};

/// The largest of kPacketSize values.
template <typename Isa>
inline float max_of_rays(const float* values) {
  typename Isa::Lanes all = Isa::load(values);
  for (int i = Isa::kWidth; i < kPacketSize; i += Isa::kWidth) {
    all = Isa::max(all, Isa::load(values + i));
  }
  return Isa::reduce_max(all);
}

/// The smallest of kPacketSize values.
template <typename Isa>
inline float min_of_rays(const float* values) {
  typename Isa::Lanes all = Isa::load(values);
  for (int i = Isa::kWidth; i < kPacketSize; i += Isa::kWidth) {
    all = Isa::min(all, Isa::load(values + i));
  }
  return -Isa::reduce_max(Isa::splat(-0.0f) - all);
}

/// Bounds of the rays of a packet.
template <typename Isa>
struct Frustum {
  float enter_origin[3], leave_origin[3], inverse_lo[3], inverse_hi[3], slack;

  explicit Frustum(const PacketRays<Isa>& rays) : slack(max_of_rays<Isa>(rays.slack)) {
    for (int k = 0; k < 3; ++k) {
      const float lo = min_of_rays<Isa>(rays.origin[k]), hi = max_of_rays<Isa>(rays.origin[k]);
      enter_origin[k] = rays.backwards[k] ? lo : hi;
      leave_origin[k] = rays.backwards[k] ? hi : lo;
      inverse_lo[k] = min_of_rays<Isa>(rays.inverse[k]);
      inverse_hi[k] = max_of_rays<Isa>(rays.inverse[k]);
    }
  }
};

/// NodeTest for all rays of a packet at once.
template <typename Isa>
struct FrustumTest {
  using Lanes = typename Isa::Lanes;

  Lanes enter_origin[3], leave_origin[3], inverse_lo[3], inverse_hi[3], slack;
  std::size_t near[3];

  FrustumTest(const PacketRays<Isa>& rays, const Frustum<Isa>& f)
      : slack(Isa::splat(f.slack * kNodeSlackScale)) {
    for (int k = 0; k < 3; ++k) {
      enter_origin[k] = Isa::splat(f.enter_origin[k]);
      leave_origin[k] = Isa::splat(f.leave_origin[k]);
      inverse_lo[k] = Isa::splat(f.inverse_lo[k]);
      inverse_hi[k] = Isa::splat(f.inverse_hi[k]);
      near[k] = rays.backwards[k] ? Isa::kWidth : 0;
    }
  }

  /// Returns a lane for each box that any ray may meet; no ray enters one before `enters`.
  std::uint32_t intersect(const WideNode<Isa::kWidth>& node, float limit, Lanes& enters) const {
    Lanes enter = Isa::splat(0);
    Lanes leave = Isa::splat(std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      const Lanes near_plane = Isa::load(node.planes[k] + near[k]) - enter_origin[k];
      const Lanes far_plane = Isa::load(node.planes[k] + (Isa::kWidth - near[k])) - leave_origin[k];
      enter = Isa::max(enter, Isa::min(near_plane * inverse_lo[k], near_plane * inverse_hi[k]));
      leave = Isa::min(leave, Isa::max(far_plane * inverse_lo[k], far_plane * inverse_hi[k]));
    }
    leave = Isa::fused_multiply_add(leave, Isa::splat(kFrustumLeaveScale), slack);
    enters = enter;
    return Isa::less_equal_mask(enter, Isa::min(leave, Isa::splat(limit)));
  }

 private:
  /// The single ray's test multiplies by a widened inverse and rounds in other places: this is two
  /// roundings wider.
  static constexpr float kFrustumLeaveScale = kNodeLeaveScale + 0x1p-21f;
};

/// The triangles of a block whose boxes the frustum may enter at `limit` or before.
template <typename Isa>
inline std::uint32_t intersect_frustum(const PacketRays<Isa>& rays, const Frustum<Isa>& f,
                                       const TriangleBlock& block, float limit) {
  Lanes enter = splat(0), leave = splat(std::numeric_limits<float>::infinity());
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    const Lanes a = load(block.v + TriangleBlock::at(0, axis)),
                b = load(block.v + TriangleBlock::at(1, axis)),
                c = load(block.v + TriangleBlock::at(2, axis));
    const Lanes lo = min_lanes(min_lanes(a, b), c);
    const Lanes hi = max_lanes(max_lanes(a, b), c);
    const Lanes near = (rays.backwards[k] ? hi : lo) - splat(f.enter_origin[k]);
    const Lanes far = (rays.backwards[k] ? lo : hi) - splat(f.leave_origin[k]);
    const Lanes inverse_lo = splat(f.inverse_lo[k]), inverse_hi = splat(f.inverse_hi[k]);
    enter = max_lanes(enter, min_lanes(near * inverse_lo, near * inverse_hi));
    leave = min_lanes(leave, max_lanes(far * inverse_lo, far * inverse_hi));
  }
  leave = fused_multiply_add(leave, splat(kLeaveScale), splat(f.slack));
  return bits(_mm256_and_ps(at_least(leave, enter), at_least(splat(limit), enter)));
}

}  // namespace tessera::render::kernels
