#pragma once

#include "worker/accel/traversal/dependencies.h"

// Functions between these two macros may use AVX-512 (F, BW, DQ and VL); everything else in the
// program is compiled for the baseline, so that it runs on every supported processor.
//
// A function of a region must not have a symbol in common with baseline code, since the linker
// keeps only one copy of each inline function. So the region holds only members of Avx512,
// templates over an instruction set with a local type as their argument (see kernel_avx512.cpp),
// and functions of namespace avx512; headers included inside it include only dependencies.h and
// each other. Compiler options for the whole file would compile every inline function of every
// header for AVX-512.
#define TESSERA_PRAGMA(text) _Pragma(#text)
#if defined(__clang__)
#define TESSERA_BEGIN_AVX512           \
  TESSERA_PRAGMA(clang attribute push( \
      __attribute__((target("avx512f,avx512bw,avx512dq,avx512vl"))), apply_to = function))
#define TESSERA_END_AVX512 TESSERA_PRAGMA(clang attribute pop)
#else
#define TESSERA_BEGIN_AVX512       \
  TESSERA_PRAGMA(GCC push_options) \
  TESSERA_PRAGMA(GCC target("avx512f,avx512bw,avx512dq,avx512vl"))
#define TESSERA_END_AVX512 TESSERA_PRAGMA(GCC pop_options)
#endif

TESSERA_BEGIN_AVX512

namespace tessera::render::kernels {

/// The operations that the traversal templates need, in AVX-512. Avx2 explains the members.
struct Avx512 {
  static constexpr int kWidth = 16;
  using Lanes = __m512;

  static Lanes load(const float* p) { return _mm512_load_ps(p); }
  static Lanes splat(float x) { return _mm512_set1_ps(x); }
  static void store(float* p, Lanes x) { _mm512_store_ps(p, x); }

  static Lanes min(Lanes a, Lanes b) { return _mm512_min_ps(b, a); }
  static Lanes max(Lanes a, Lanes b) { return _mm512_max_ps(b, a); }

  static Lanes fused_multiply_add(Lanes a, Lanes b, Lanes c) { return _mm512_fmadd_ps(a, b, c); }
  static Lanes difference_of_products(Lanes a, Lanes b, Lanes c, Lanes d) {
    const Lanes cd = _mm512_mul_ps(c, d);
    const Lanes error = _mm512_fnmadd_ps(c, d, cd);
    return _mm512_add_ps(_mm512_fmsub_ps(a, b, cd), error);
  }

  static std::uint32_t less_equal_mask(Lanes a, Lanes b) {
    return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ);
  }
  static std::uint32_t not_equal_mask(Lanes a, Lanes b) {
    return _mm512_cmp_ps_mask(a, b, _CMP_NEQ_UQ);
  }
  static float reduce_max(Lanes x) { return _mm512_reduce_max_ps(x); }

  class ChildOrder {
   public:
    explicit ChildOrder(Lanes enters) {
      const __m512i lane = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
      const __m512i distance =
          _mm512_andnot_si512(_mm512_set1_epi32(15), _mm512_castps_si512(enters));
      keys_ = _mm512_or_si512(distance, lane);
      _mm512_store_si512(stored_, keys_);
    }
    __m128i compress_keys(std::uint32_t mask) const {
      return _mm512_castsi512_si128(
          _mm512_mask_compress_epi32(_mm512_set1_epi32(-1), static_cast<__mmask16>(mask), keys_));
    }
    std::uint32_t nearer(int lane) const {
      return _mm512_cmplt_epi32_mask(keys_, _mm512_set1_epi32(stored_[lane]));
    }

   private:
    __m512i keys_;
    alignas(64) std::int32_t stored_[kWidth];
  };

  static __m128i gather_children(const WideNode<kWidth>& node, __m128i lanes) {
    return _mm512_castsi512_si128(
        _mm512_permutexvar_epi32(_mm512_castsi128_si512(lanes), _mm512_load_si512(node.children)));
  }

  static void store_compressed(std::uint32_t* to, const std::uint32_t* lanes, std::uint32_t mask) {
    _mm512_storeu_si512(
        to, _mm512_maskz_compress_epi32(static_cast<__mmask16>(mask), _mm512_load_si512(lanes)));
  }
};

}  // namespace tessera::render::kernels

TESSERA_END_AVX512
