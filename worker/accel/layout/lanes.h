#pragma once

#include <immintrin.h>

#include <cstdint>

namespace tessera::render {

/// Eight floats; AVX2 and FMA are part of the baseline. Each lane performs the IEEE operations of
/// the scalar code, so results have the same bits.
using Lanes = __m256;

inline Lanes load(const float* p) {
  return _mm256_load_ps(p);
}
inline Lanes splat(float x) {
  return _mm256_set1_ps(x);
}

/// Minimum and maximum per lane, as b < a ? b : a and b > a ? b : a; both return a where either
/// operand is NaN.
inline Lanes min_lanes(Lanes a, Lanes b) {
  return _mm256_min_ps(b, a);
}
inline Lanes max_lanes(Lanes a, Lanes b) {
  return _mm256_max_ps(b, a);
}

inline Lanes fused_multiply_add(Lanes a, Lanes b, Lanes c) {
  return _mm256_fmadd_ps(a, b, c);
}

/// Computes a * b - c * d as difference_of_products() of math/vector.h does.
inline Lanes difference_of_products(Lanes a, Lanes b, Lanes c, Lanes d) {
  const Lanes cd = _mm256_mul_ps(c, d);
  const Lanes error = _mm256_fnmadd_ps(c, d, cd);
  return _mm256_add_ps(_mm256_fmsub_ps(a, b, cd), error);
}

/// Sets all bits of the lanes where a >= b; clears the others and those where either is NaN.
inline Lanes at_least(Lanes a, Lanes b) {
  return _mm256_cmp_ps(a, b, _CMP_GE_OQ);
}

/// Returns one bit per lane of a comparison mask.
inline std::uint32_t bits(Lanes mask) {
  return static_cast<std::uint32_t>(_mm256_movemask_ps(mask));
}

}  // namespace tessera::render
