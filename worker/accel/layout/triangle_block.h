#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "worker/accel/layout/lanes.h"
#include "worker/geometry/object_ray.h"
#include "worker/geometry/triangle.h"

namespace tessera::render {

/// Triangles in a block.
inline constexpr int kBlockSize = 8;

/// Up to eight triangles, one per lane. Unused lanes contain a point, which is never hit because
/// its determinant is zero.
struct alignas(64) TriangleBlock {
  /// Returns the index in `v` of the lanes of a vertex's coordinate.
  static constexpr std::size_t at(std::size_t vertex, std::size_t axis) {
    return (3 * vertex + axis) * kBlockSize;
  }

  void set(std::size_t lane, const std::array<Vec3f, 3>& corners, std::uint32_t id_rank) {
    for (std::size_t vertex = 0; vertex < 3; ++vertex) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        v[at(vertex, axis) + lane] = corners[vertex][static_cast<int>(axis)];
      }
    }
    rank[lane] = id_rank;
  }
  Vec3f corner(std::size_t lane, std::size_t vertex) const {
    return {v[at(vertex, 0) + lane], v[at(vertex, 1) + lane], v[at(vertex, 2) + lane]};
  }
  /// Returns whether the lane is in use: a triangle that can be hit is not a point.
  bool has_triangle(std::size_t lane) const {
    return corner(lane, 0) != corner(lane, 1) || corner(lane, 0) != corner(lane, 2);
  }

  float v[9 * kBlockSize] = {};         // see at()
  std::uint32_t rank[kBlockSize] = {};  // index among all triangles of the mesh, in id order
};

/// Interpolates all corners as lerp_bounded() of geometry/motion.h does. Does not set the ranks of
/// `out`.
inline void lerp_bounded(const TriangleBlock& from, const TriangleBlock& to, float f,
                         TriangleBlock& out) {
  const Lanes fraction = splat(f);
  for (int i = 0; i < 9 * kBlockSize; i += kBlockSize) {
    const Lanes a = load(from.v + i), b = load(to.v + i);
    const Lanes v = fused_multiply_add(fraction, b - a, a);
    _mm256_store_ps(out.v + i, min_lanes(max_lanes(v, min_lanes(a, b)), max_lanes(a, b)));
  }
}

/// A ray prepared for triangle blocks.
struct BlockRay {
  Lanes ox, oy, oz, sx, sy;  // origin and shear in the permuted axes kx, ky, kz
  std::size_t x, y, z;       // offsets of kx, ky and kz among a vertex's coordinates, in floats
  const ObjectRay* ray;

  explicit BlockRay(const ObjectRay& r)
      : ox(splat(component(r.origin, r.kx))),
        oy(splat(component(r.origin, r.ky))),
        oz(splat(component(r.origin, r.kz))),
        sx(splat(r.sx)),
        sy(splat(r.sy)),
        x(std::size_t{r.kx} * kBlockSize),
        y(std::size_t{r.ky} * kBlockSize),
        z(std::size_t{r.kz} * kBlockSize),
        ray(&r) {}
};

/// Hits found by intersect_block(); only the lanes of the returned mask are defined.
struct BlockHits {
  alignas(32) float t[kBlockSize];
  alignas(32) float b0[kBlockSize];
  alignas(32) float b1[kBlockSize];
  alignas(32) float b2[kBlockSize];
};

/// Returns the lanes that intersect_triangle() of geometry/triangle.h accepts with 0 <= t <= limit;
/// t and barycentrics have the same bits. NaN in any intermediate makes t NaN, which the last
/// comparison rejects.
inline std::uint32_t intersect_block(const BlockRay& block_ray, const TriangleBlock& block,
                                     float limit, BlockHits& hits) {
  const ObjectRay& ray = *block_ray.ray;
  const auto corner = [&](std::size_t vertex, std::size_t axis) {
    return load(block.v + TriangleBlock::at(vertex, axis));
  };
  const float* const x = block.v + block_ray.x;
  const float* const y = block.v + block_ray.y;
  const float* const z = block.v + block_ray.z;
  constexpr std::size_t kVertex = std::size_t{3} * kBlockSize;
  const Lanes sx = block_ray.sx, sy = block_ray.sy;
  const Lanes az = load(z) - block_ray.oz, bz = load(z + kVertex) - block_ray.oz,
              cz = load(z + 2 * kVertex) - block_ray.oz;
  const Lanes ax = (load(x) - block_ray.ox) - sx * az;
  const Lanes ay = (load(y) - block_ray.oy) - sy * az;
  const Lanes bx = (load(x + kVertex) - block_ray.ox) - sx * bz;
  const Lanes by = (load(y + kVertex) - block_ray.oy) - sy * bz;
  const Lanes cx = (load(x + 2 * kVertex) - block_ray.ox) - sx * cz;
  const Lanes cy = (load(y + 2 * kVertex) - block_ray.oy) - sy * cz;
  const Lanes u = difference_of_products(cx, by, cy, bx);
  const Lanes v = difference_of_products(ax, cy, ay, cx);
  const Lanes w = difference_of_products(bx, ay, by, ax);
  const Lanes zero = _mm256_setzero_ps();
  const Lanes same_sign = _mm256_or_ps(at_least(min_lanes(min_lanes(u, v), w), zero),
                                       at_least(zero, max_lanes(max_lanes(u, v), w)));
  if (bits(same_sign) == 0) return 0;
  const Lanes determinant = (u + v) + w;
  const Lanes accepted = _mm256_and_ps(same_sign, _mm256_cmp_ps(determinant, zero, _CMP_NEQ_UQ));
  if (bits(accepted) == 0) return 0;
  const Lanes b0 = u / determinant, b1 = v / determinant, b2 = w / determinant;
  const Lanes sz = splat(ray.sz);
  Lanes t = (b0 * (sz * az) + b1 * (sz * bz)) + b2 * (sz * cz);
  Lanes enter = splat(-std::numeric_limits<float>::infinity());
  Lanes leave = splat(std::numeric_limits<float>::infinity());
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    const Lanes lo = min_lanes(min_lanes(corner(0, axis), corner(1, axis)), corner(2, axis));
    const Lanes hi = max_lanes(max_lanes(corner(0, axis), corner(1, axis)), corner(2, axis));
    const bool backwards = ray.backwards[axis] != 0;
    const Lanes origin = splat(component(ray.origin, k)),
                inverse = splat(component(ray.inverse, k));
    enter = max_lanes(enter, ((backwards ? hi : lo) - origin) * inverse);
    leave = min_lanes(leave, ((backwards ? lo : hi) - origin) * inverse);
  }
  leave = fused_multiply_add(leave, splat(kLeaveScale), splat(ray.slack));
  t = min_lanes(max_lanes(t, enter), leave);
  _mm256_store_ps(hits.t, t);
  _mm256_store_ps(hits.b0, b0);
  _mm256_store_ps(hits.b1, b1);
  _mm256_store_ps(hits.b2, b2);
  const Lanes in_range = _mm256_and_ps(at_least(t, zero), at_least(splat(limit), t));
  return bits(_mm256_and_ps(_mm256_and_ps(accepted, at_least(leave, enter)), in_range));
}

}  // namespace tessera::render
