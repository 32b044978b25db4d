#include <immintrin.h>

#include <cmath>
#include <limits>

#include "worker/accel/kernels.h"
#include "worker/accel/lanes.h"
#include "worker/geometry/object_ray.h"

// Only what follows may use AVX-512, not the inline functions of headers: the linker keeps one copy
// of those, and it must run everywhere.
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx512f,avx512bw,avx512dq,avx512vl"))), \
                             apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx512f,avx512bw,avx512dq,avx512vl")
#endif

namespace tessera::render::avx512 {
namespace {

constexpr int kWidth = 16;

/// A value per child of a node.
using NodeLanes = __m512;

NodeLanes load_lanes(const float* p) {
  return _mm512_load_ps(p);
}
NodeLanes splat_lanes(float x) {
  return _mm512_set1_ps(x);
}
void store_lanes(float* p, NodeLanes x) {
  _mm512_store_ps(p, x);
}
NodeLanes lesser(NodeLanes a, NodeLanes b) {
  return _mm512_min_ps(b, a);
}
NodeLanes greater(NodeLanes a, NodeLanes b) {
  return _mm512_max_ps(b, a);
}
NodeLanes fused_multiply_add(NodeLanes a, NodeLanes b, NodeLanes c) {
  return _mm512_fmadd_ps(a, b, c);
}
NodeLanes difference_of_products(NodeLanes a, NodeLanes b, NodeLanes c, NodeLanes d) {
  const NodeLanes cd = _mm512_mul_ps(c, d);
  const NodeLanes error = _mm512_fnmadd_ps(c, d, cd);
  return _mm512_add_ps(_mm512_fmsub_ps(a, b, cd), error);
}
std::uint32_t lanes_at_most(NodeLanes a, NodeLanes b) {
  return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ);
}
std::uint32_t lanes_unequal(NodeLanes a, NodeLanes b) {
  return _mm512_cmp_ps_mask(a, b, _CMP_NEQ_UQ);
}
float greatest_lane(NodeLanes x) {
  return _mm512_reduce_max_ps(x);
}

/// Orders children by the distance at which they are entered, each different from all others.
class Order {
 public:
  explicit Order(NodeLanes enters) {
    const __m512i lane = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const __m512i distance =
        _mm512_andnot_si512(_mm512_set1_epi32(15), _mm512_castps_si512(enters));
    keys_ = _mm512_or_si512(distance, lane);
    _mm512_store_si512(stored_, keys_);
  }
  /// Keys of the lanes in `met`, at most four: distances with the lane in their lowest bits; then
  /// the largest number.
  __m128i pack(std::uint32_t met) const {
    return _mm512_castsi512_si128(
        _mm512_mask_compress_epi32(_mm512_set1_epi32(-1), static_cast<__mmask16>(met), keys_));
  }
  /// The lanes nearer than `lane`.
  std::uint32_t nearer(int lane) const {
    return _mm512_cmplt_epi32_mask(keys_, _mm512_set1_epi32(stored_[lane]));
  }

 private:
  __m512i keys_;
  alignas(64) std::int32_t stored_[kWidth];
};

/// The children in the lanes named.
__m128i children_of(const WideNode<kWidth>& node, __m128i lanes) {
  return _mm512_castsi512_si128(
      _mm512_permutexvar_epi32(_mm512_castsi128_si512(lanes), _mm512_load_si512(node.children)));
}

/// Stores the lanes in `met`, and anything behind them.
void store_packed(std::uint32_t* to, const std::uint32_t* lanes, std::uint32_t met) {
  _mm512_storeu_si512(
      to, _mm512_maskz_compress_epi32(static_cast<__mmask16>(met), _mm512_load_si512(lanes)));
}

#include "worker/accel/packet.inc"

}  // namespace

bool closest_hit(const AccelTrees<16>& trees, const Ray& ray, Hit& hit) {
  return find_closest<false>(trees, ray, nullptr, hit);
}
bool closest_hit(const AccelTrees<16>& trees, const Ray& ray, const HitFilter& filter, Hit& hit) {
  return find_closest<true>(trees, ray, &filter, hit);
}
bool any_hit(const AccelTrees<16>& trees, const Ray& ray) {
  return find_any<false>(trees, ray, nullptr);
}
bool any_hit(const AccelTrees<16>& trees, const Ray& ray, const HitFilter& filter) {
  return find_any<true>(trees, ray, &filter);
}
std::uint64_t closest_hits(const AccelTrees<16>& trees, std::span<const Ray> rays, Hit* hits) {
  return find_closest_of(trees, rays, hits);
}
std::uint64_t any_hits(const AccelTrees<16>& trees, std::span<const Ray> rays) {
  return find_any_of(trees, rays);
}

}  // namespace tessera::render::avx512

#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
