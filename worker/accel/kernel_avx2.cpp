#include <immintrin.h>

#include <cmath>
#include <limits>

#include "worker/accel/kernels.h"
#include "worker/accel/lanes.h"
#include "worker/geometry/object_ray.h"

namespace tessera::render::avx2 {
namespace {

constexpr int kWidth = 8;

/// A value per child of a node.
using NodeLanes = __m256;

NodeLanes load_lanes(const float* p) {
  return _mm256_load_ps(p);
}
NodeLanes splat_lanes(float x) {
  return _mm256_set1_ps(x);
}
void store_lanes(float* p, NodeLanes x) {
  _mm256_store_ps(p, x);
}
std::uint32_t lanes_at_most(NodeLanes a, NodeLanes b) {
  return bits(_mm256_cmp_ps(a, b, _CMP_LE_OQ));
}
std::uint32_t lanes_unequal(NodeLanes a, NodeLanes b) {
  return bits(_mm256_cmp_ps(a, b, _CMP_NEQ_UQ));
}
float greatest_lane(NodeLanes x) {
  __m128 four = _mm_max_ps(_mm256_castps256_ps128(x), _mm256_extractf128_ps(x, 1));
  four = _mm_max_ps(four, _mm_movehl_ps(four, four));
  return _mm_cvtss_f32(_mm_max_ss(four, _mm_movehdup_ps(four)));
}

/// The lanes in `met`, then anything.
__m256i pack_lanes(__m256i lanes, std::uint32_t met) {
  const std::uint64_t bytes = _pdep_u64(met, 0x0101010101010101u) * 0xFF;
  const auto places = static_cast<long long>(_pext_u64(0x0706050403020100u, bytes));
  return _mm256_permutevar8x32_epi32(lanes, _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(places)));
}

/// Orders children by the distance at which they are entered, each different from all others.
class Order {
 public:
  explicit Order(NodeLanes enters) {
    const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    const __m256i distance = _mm256_andnot_si256(_mm256_set1_epi32(7), _mm256_castps_si256(enters));
    keys_ = _mm256_or_si256(distance, lane);
    _mm256_store_si256(reinterpret_cast<__m256i*>(stored_), keys_);
  }
  /// Keys of the lanes in `met`, at most four: distances with the lane in their lowest bits; then
  /// the largest number.
  __m128i pack(std::uint32_t met) const {
    const __m128i packed = _mm256_castsi256_si128(pack_lanes(keys_, met));
    const __m128i count = _mm_set1_epi32(__builtin_popcount(met));
    return _mm_or_si128(packed, _mm_cmpgt_epi32(_mm_setr_epi32(1, 2, 3, 4), count));
  }
  /// The lanes nearer than `lane`.
  std::uint32_t nearer(int lane) const {
    const __m256i key = _mm256_set1_epi32(stored_[lane]);
    return bits(_mm256_castsi256_ps(_mm256_cmpgt_epi32(key, keys_)));
  }

 private:
  __m256i keys_;
  alignas(32) std::int32_t stored_[kWidth];
};

/// The children in the lanes named.
__m128i children_of(const WideNode<kWidth>& node, __m128i lanes) {
  const __m256i all = _mm256_load_si256(reinterpret_cast<const __m256i*>(node.children));
  return _mm256_castsi256_si128(_mm256_permutevar8x32_epi32(all, _mm256_castsi128_si256(lanes)));
}

/// Stores the lanes in `met`, and anything behind them.
void store_packed(std::uint32_t* to, const std::uint32_t* lanes, std::uint32_t met) {
  const __m256i all = _mm256_load_si256(reinterpret_cast<const __m256i*>(lanes));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), pack_lanes(all, met));
}

#include "worker/accel/packet.inc"

}  // namespace

bool closest_hit(const AccelTrees<8>& trees, const Ray& ray, Hit& hit) {
  return find_closest<false>(trees, ray, nullptr, hit);
}
bool closest_hit(const AccelTrees<8>& trees, const Ray& ray, const HitFilter& filter, Hit& hit) {
  return find_closest<true>(trees, ray, &filter, hit);
}
bool any_hit(const AccelTrees<8>& trees, const Ray& ray) {
  return find_any<false>(trees, ray, nullptr);
}
bool any_hit(const AccelTrees<8>& trees, const Ray& ray, const HitFilter& filter) {
  return find_any<true>(trees, ray, &filter);
}
std::uint64_t closest_hits(const AccelTrees<8>& trees, std::span<const Ray> rays, Hit* hits) {
  return find_closest_of(trees, rays, hits);
}
std::uint64_t any_hits(const AccelTrees<8>& trees, std::span<const Ray> rays) {
  return find_any_of(trees, rays);
}

}  // namespace tessera::render::avx2
