#pragma once

#include "worker/accel/traversal/dependencies.h"

namespace tessera::render::kernels {

/// The operations that the traversal templates need, in AVX2: one lane per child of a node. Part of
/// the baseline instruction set. Avx512 has the same members for AVX-512.
struct Avx2 {
  static constexpr int kWidth = 8;
  using Lanes = __m256;

  static Lanes load(const float* p) { return _mm256_load_ps(p); }
  static Lanes splat(float x) { return _mm256_set1_ps(x); }
  static void store(float* p, Lanes x) { _mm256_store_ps(p, x); }

  /// b < a ? b : a and b > a ? b : a: a where either is NaN.
  static Lanes min(Lanes a, Lanes b) { return min_lanes(a, b); }
  static Lanes max(Lanes a, Lanes b) { return max_lanes(a, b); }

  static Lanes fused_multiply_add(Lanes a, Lanes b, Lanes c) {
    return tessera::render::fused_multiply_add(a, b, c);
  }
  /// a * b - c * d, as difference_of_products() of math/vector.h.
  static Lanes difference_of_products(Lanes a, Lanes b, Lanes c, Lanes d) {
    return tessera::render::difference_of_products(a, b, c, d);
  }

  /// One bit per lane in which a <= b; clear where either is NaN.
  static std::uint32_t less_equal_mask(Lanes a, Lanes b) {
    return bits(_mm256_cmp_ps(a, b, _CMP_LE_OQ));
  }
  /// One bit per lane in which a != b; set where either is NaN.
  static std::uint32_t not_equal_mask(Lanes a, Lanes b) {
    return bits(_mm256_cmp_ps(a, b, _CMP_NEQ_UQ));
  }
  /// The largest lane. Requires no NaN.
  static float reduce_max(Lanes x) {
    __m128 four = _mm_max_ps(_mm256_castps256_ps128(x), _mm256_extractf128_ps(x, 1));
    four = _mm_max_ps(four, _mm_movehl_ps(four, four));
    return _mm_cvtss_f32(_mm_max_ss(four, _mm_movehdup_ps(four)));
  }

  /// Moves the lanes of `mask` to the front; the lanes behind them are undefined.
  static __m256i compress(__m256i lanes, std::uint32_t mask) {
    const std::uint64_t bytes = _pdep_u64(mask, 0x0101010101010101u) * 0xFF;
    const auto places = static_cast<long long>(_pext_u64(0x0706050403020100u, bytes));
    return _mm256_permutevar8x32_epi32(lanes, _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(places)));
  }

  /// The order of a node's children by the distance at which the ray enters them. Ties are broken
  /// by lane: the lane number replaces the lowest bits of each distance, so that all keys differ.
  class ChildOrder {
   public:
    /// Requires distances of at least +0, whose bits order as integers do.
    explicit ChildOrder(Lanes enters) {
      const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
      const __m256i distance =
          _mm256_andnot_si256(_mm256_set1_epi32(7), _mm256_castps_si256(enters));
      keys_ = _mm256_or_si256(distance, lane);
      _mm256_store_si256(reinterpret_cast<__m256i*>(stored_), keys_);
    }
    /// The keys of the lanes in `mask`, then the largest unsigned number. Requires at most four.
    __m128i compress_keys(std::uint32_t mask) const {
      const __m128i packed = _mm256_castsi256_si128(compress(keys_, mask));
      const __m128i count = _mm_set1_epi32(__builtin_popcount(mask));
      return _mm_or_si128(packed, _mm_cmpgt_epi32(_mm_setr_epi32(1, 2, 3, 4), count));
    }
    /// One bit per lane that is nearer than `lane`.
    std::uint32_t nearer(int lane) const {
      const __m256i key = _mm256_set1_epi32(stored_[lane]);
      return bits(_mm256_castsi256_ps(_mm256_cmpgt_epi32(key, keys_)));
    }

   private:
    __m256i keys_;
    alignas(32) std::int32_t stored_[kWidth];
  };

  /// The children whose lane numbers are in `lanes`.
  static __m128i gather_children(const WideNode<kWidth>& node, __m128i lanes) {
    const __m256i all = _mm256_load_si256(reinterpret_cast<const __m256i*>(node.children));
    return _mm256_castsi256_si128(_mm256_permutevar8x32_epi32(all, _mm256_castsi128_si256(lanes)));
  }

  /// Stores the lanes of `mask` at `to`, packed. Overwrites kWidth elements.
  static void store_compressed(std::uint32_t* to, const std::uint32_t* lanes, std::uint32_t mask) {
    const __m256i all = _mm256_load_si256(reinterpret_cast<const __m256i*>(lanes));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), compress(all, mask));
  }
};

}  // namespace tessera::render::kernels
