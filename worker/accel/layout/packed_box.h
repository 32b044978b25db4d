#pragma once

#include <immintrin.h>

#include <limits>

#include "worker/geometry/bounds.h"

namespace tessera::render {

/// A box with its upper corner negated, so that one minimum instruction extends it.
class PackedBox {
 public:
  PackedBox() : value_(_mm256_set1_ps(std::numeric_limits<float>::infinity())) {}
  explicit PackedBox(__m256 value) : value_(value) {}
  /// The box of one point, whose fourth lane is ignored.
  explicit PackedBox(__m128 point)
      : value_(_mm256_set_m128(_mm_xor_ps(point, _mm_set1_ps(-0.0f)), point)) {}

  void extend(const PackedBox& b) { value_ = _mm256_min_ps(value_, b.value_); }
  PackedBox intersect(const PackedBox& b) const {
    return PackedBox(_mm256_max_ps(value_, b.value_));
  }
  bool empty() const {  // unless lo - hi <= 0 on all axes
    const __m128 size =
        _mm_add_ps(_mm256_castps256_ps128(value_), _mm256_extractf128_ps(value_, 1));
    return (_mm_movemask_ps(_mm_cmple_ps(size, _mm_setzero_ps())) & 7) != 7;
  }
  double half_area() const { return box().half_area(); }
  Box3f box() const {
    alignas(32) float v[8];
    _mm256_store_ps(v, value_);
    return {{v[0], v[1], v[2]}, {-v[4], -v[5], -v[6]}};
  }

 private:
  __m256 value_;
};

}  // namespace tessera::render
