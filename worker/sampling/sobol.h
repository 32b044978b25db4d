#pragma once

#include <immintrin.h>

#include <array>
#include <cstdint>

namespace tessera::render {

/// Four 32-bit lanes, one per dimension. Integer arithmetic: the results equal those of scalar
/// code.
using Lanes4 = std::uint32_t __attribute__((vector_size(16)));

/// unit_float() of hash.h in each lane.
inline __m128 unit_floats(Lanes4 bits) {
  return _mm_mul_ps(_mm_cvtepi32_ps(_mm_srli_epi32(reinterpret_cast<__m128i>(bits), 8)),
                    _mm_set1_ps(0x1p-24f));
}

/// Reverses the 32 bits of each lane: the halves of every byte by a table, then the bytes.
inline Lanes4 reverse_bits(Lanes4 x) {
  // The reversals of 0 to 15, as the high and as the low half of a byte.
  const __m128i high = _mm_setr_epi8(0x00, -0x80, 0x40, -0x40, 0x20, -0x60, 0x60, -0x20, 0x10,
                                     -0x70, 0x50, -0x30, 0x30, -0x50, 0x70, -0x10);
  const __m128i low = _mm_setr_epi8(0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15);
  const __m128i bytes = _mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12);
  const __m128i half = _mm_set1_epi8(15);
  const auto v = reinterpret_cast<__m128i>(x);
  const __m128i from_low = _mm_shuffle_epi8(high, _mm_and_si128(v, half));
  const __m128i from_high = _mm_shuffle_epi8(low, _mm_and_si128(_mm_srli_epi32(v, 4), half));
  return reinterpret_cast<Lanes4>(_mm_shuffle_epi8(_mm_or_si128(from_low, from_high), bytes));
}

constexpr std::uint32_t reverse_bits(std::uint32_t x) {
  x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
  x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
  x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
  x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
  return (x >> 16) | (x << 16);
}

/// The permutation at the heart of hashed Owen scrambling: bit i of the result depends on bits
/// 0..i of `x` only, so on bit-reversed numbers it is a nested uniform scramble. `T` is
/// std::uint32_t or Lanes4. Source: Laine & Karras 2011; constants: N. Vegdahl, "Building a
/// better LK hash", 2021.
template <typename T>
constexpr T laine_karras(T x, T seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}

/// The Sobol' sequence in 4 dimensions with bit-reversed numbers (bit 0 stands for 1/2), as one
/// entry per value of each nibble of the bit-reversed index (bit 31 is bit 0 of the index).
struct SobolTable {
  alignas(16) std::array<std::array<std::array<std::uint32_t, 4>, 16>, 8> nibbles;
};

/// Adds over GF(2) in each dimension.
constexpr void add(std::array<std::uint32_t, 4>& to, const std::array<std::uint32_t, 4>& number) {
  for (std::uint32_t d = 0; d < 4; ++d) to[d] ^= number[d];
}

/// Direction numbers of S. Joe & F. Kuo, "new-joe-kuo-6", dimensions 1 to 4. Dimensions 0 and 1
/// form a (0, 2)-sequence.
constexpr SobolTable make_sobol_table() {
  std::array<std::array<std::uint32_t, 4>, 32> direction{};  // [bit of the index][dimension]
  struct Polynomial {
    std::uint32_t degree, coefficients;
    std::array<std::uint32_t, 3> m;
  };
  constexpr std::array<Polynomial, 3> kPolynomials = {
      Polynomial{1, 0, {1, 0, 0}}, Polynomial{2, 1, {1, 3, 0}}, Polynomial{3, 1, {1, 3, 1}}};
  for (std::uint32_t bit = 0; bit < 32; ++bit) direction[bit][0] = 1u << bit;
  for (std::uint32_t d = 0; d < 3; ++d) {
    const Polynomial& p = kPolynomials[d];
    std::array<std::uint32_t, 32> v{};
    for (std::uint32_t i = 0; i < 32; ++i) {
      if (i < p.degree) {
        v[i] = p.m[i] << (31 - i);
        continue;
      }
      v[i] = v[i - p.degree] ^ (v[i - p.degree] >> p.degree);
      for (std::uint32_t k = 1; k < p.degree; ++k) {
        if ((p.coefficients >> (p.degree - 1 - k) & 1) != 0) v[i] ^= v[i - k];
      }
    }
    for (std::uint32_t i = 0; i < 32; ++i) direction[i][d + 1] = reverse_bits(v[i]);
  }
  SobolTable table{};
  for (std::uint32_t nibble = 0; nibble < 8; ++nibble) {
    for (std::uint32_t value = 0; value < 16; ++value) {
      for (std::uint32_t bit = 0; bit < 4; ++bit) {
        if ((value >> bit & 1) == 0) continue;
        add(table.nibbles[nibble][value], direction[31 - (nibble * 4 + bit)]);
      }
    }
  }
  return table;
}

inline constexpr SobolTable kSobolTable = make_sobol_table();

/// The point of the sequence with this bit-reversed index, bit-reversed.
inline Lanes4 reversed_sobol(std::uint32_t reversed_index) {
  Lanes4 x = {0, 0, 0, 0};
  for (std::size_t nibble = 0; nibble < 8; ++nibble) {
    const auto& entry = kSobolTable.nibbles[nibble][reversed_index >> (4 * nibble) & 15u];
    x ^= reinterpret_cast<Lanes4>(_mm_load_si128(reinterpret_cast<const __m128i*>(entry.data())));
  }
  return x;
}

}  // namespace tessera::render
