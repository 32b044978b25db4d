#pragma once

#include <immintrin.h>

#include <cstddef>
#include <cstdint>

#include "worker/geometry/shapes/blobs/blob.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Four doubles; AVX2 is part of the baseline. Each lane performs the IEEE operations of scalar
/// code.
using BlobLanes = double __attribute__((vector_size(32)));
using BlobVectors = Vec3<BlobLanes>;

inline BlobLanes spread(double x) {
  return BlobLanes{x, x, x, x};
}
inline BlobVectors spread(const Vec3d& v) {
  return {spread(v.x), spread(v.y), spread(v.z)};
}
inline BlobLanes larger(BlobLanes a, BlobLanes b) {
  return _mm256_max_pd(a, b);
}
inline BlobLanes smaller(BlobLanes a, BlobLanes b) {
  return _mm256_min_pd(a, b);
}
/// Sets all bits of the lanes where a >= b or a > b.
inline BlobLanes at_least(BlobLanes a, BlobLanes b) {
  return _mm256_cmp_pd(a, b, _CMP_GE_OQ);
}
inline BlobLanes above(BlobLanes a, BlobLanes b) {
  return _mm256_cmp_pd(a, b, _CMP_GT_OQ);
}
/// The lanes of `a` where all bits of `mask` are set, and 0 elsewhere.
inline BlobLanes only(BlobLanes mask, BlobLanes a) {
  return _mm256_and_pd(mask, a);
}
inline BlobLanes without(BlobLanes mask, BlobLanes a) {
  return _mm256_andnot_pd(mask, a);
}
/// One bit per lane of a mask.
inline std::uint32_t bits(BlobLanes mask) {
  return static_cast<std::uint32_t>(_mm256_movemask_pd(mask));
}
/// a b + c and c - a b, rounded once.
inline BlobLanes add_product(BlobLanes c, BlobLanes a, BlobLanes b) {
  return _mm256_fmadd_pd(a, b, c);
}
inline BlobLanes less_product(BlobLanes c, BlobLanes a, BlobLanes b) {
  return _mm256_fnmadd_pd(a, b, c);
}
/// 1 - a.b.
inline BlobLanes one_less_dot(const BlobVectors& a, const BlobVectors& b) {
  return less_product(less_product(less_product(spread(1), a.x, b.x), a.y, b.y), a.z, b.z);
}
inline double total(BlobLanes a) {
  return (a[0] + a[1]) + (a[2] + a[3]);
}

/// Four blobs, one per lane.
struct FourBlobs {
  BlobVectors centre, scale;
  BlobLanes strength;

  /// The blobs of `all` at four indices.
  FourBlobs(const UnitBlob* all, const BlobIndex* indices) {
    const Columns first = columns(all, indices, 0), second = columns(all, indices, 4);
    centre = {first.a, first.b, first.c};
    scale = {first.d, second.a, second.b};
    strength = second.c;
  }

  /// A point in the spaces in which the blobs are unit spheres.
  BlobVectors local(const BlobVectors& point) const { return (point - centre) * scale; }

 private:
  struct Columns {
    BlobLanes a, b, c, d;
  };

  /// Four consecutive numbers of each of four blobs, from the number `from` on: a 4x4 transpose.
  static Columns columns(const UnitBlob* all, const BlobIndex* indices, std::size_t from) {
    const auto row = [&](std::size_t lane) {
      return _mm256_load_pd(reinterpret_cast<const double*>(&all[indices[lane]]) + from);
    };
    const __m256d ac_01 = _mm256_unpacklo_pd(row(0), row(1));
    const __m256d bd_01 = _mm256_unpackhi_pd(row(0), row(1));
    const __m256d ac_23 = _mm256_unpacklo_pd(row(2), row(3));
    const __m256d bd_23 = _mm256_unpackhi_pd(row(2), row(3));
    return {.a = _mm256_permute2f128_pd(ac_01, ac_23, 0x20),
            .b = _mm256_permute2f128_pd(bd_01, bd_23, 0x20),
            .c = _mm256_permute2f128_pd(ac_01, ac_23, 0x31),
            .d = _mm256_permute2f128_pd(bd_01, bd_23, 0x31)};
  }
};

/// Copies those of four indices whose bits are set to `to`, which has room for four, and returns
/// the end of the copies. `to` may be `from` or less.
inline BlobIndex* copy_chosen(const BlobIndex* from, std::uint32_t chosen, BlobIndex* to) {
  const BlobIndex four[] = {from[0], from[1], from[2], from[3]};
  for (std::uint32_t k = 0; k < 4; ++k) {
    *to = four[k];
    to += (chosen >> k) & 1;
  }
  return to;
}

}  // namespace tessera::render
