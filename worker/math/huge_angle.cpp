#include <bit>
#include <cstdint>

#include "worker/math/elementary_kernels.h"

namespace tessera::render::elementary {
namespace {

__extension__ using U128 = unsigned __int128;

/// 64 zero bits, then the fraction bits of 2/pi, most significant first (computed with Machin's
/// formula in integers). A double needs 971 + 192 + 64 of them.
constexpr std::uint64_t kTwoOverPiBits[] = {
    0x0000000000000000, 0xa2f9836e4e441529, 0xfc2757d1f534ddc0, 0xdb6295993c439041,
    0xfe5163abdebbc561, 0xb7246e3a424dd2e0, 0x06492eea09d1921c, 0xfe1deb1cb129a73e,
    0xe88235f52ebb4484, 0xe99c7026b45f7e41, 0x3991d639835339f4, 0x9c845f8bbdf9283b,
    0x1ff897ffde05980f, 0xef2f118b5a0a6d1f, 0x6d367ecf27cb09b7, 0x4f463f669e5fea2d,
    0x7527bac7ebe5f17b, 0x3d0739f78a5292ea, 0x6bfb5fb11f8d5d08, 0x56033046fc7b6bab,
    0xf0cfbc209af4361d};

/// 64 bits of the table from bit `start` on.
std::uint64_t bits_at(int start) {
  const int word = start / 64, shift = start % 64;
  if (shift == 0) return kTwoOverPiBits[word];
  return kTwoOverPiBits[word] << shift | kTwoOverPiBits[word + 1] >> (64 - shift);
}

}  // namespace

ReducedAngle reduce_huge_angle(double x) {
  const auto bits = std::bit_cast<std::uint64_t>(x);
  const int exponent = static_cast<int>(bits >> 52 & 0x7ff) - 1075;  // |x| = mantissa * 2^exponent
  const std::uint64_t mantissa = (bits & 0xfffffffffffffULL) | 0x10000000000000ULL;
  // Bits of 2/pi above 2^(2 - exponent) only add multiples of four quadrants. The next 192 bits
  // times the mantissa, modulo 2^192, give the quadrant (2 bits) and 190 bits of fraction.
  const int start = 64 + exponent - 2;
  const std::uint64_t w0 = bits_at(start), w1 = bits_at(start + 64), w2 = bits_at(start + 128);
  const U128 low = U128{mantissa} * w2;
  const U128 middle = U128{mantissa} * w1 + (low >> 64);
  const std::uint64_t high_word = mantissa * w0;      // modulo 2^64, which drops whole turns
  const U128 top = (U128{high_word} << 64) + middle;  // bits 64..191 of the product
  int quadrant = static_cast<int>(top >> 126);
  U128 fraction = top << 2 | static_cast<std::uint64_t>(low) >> 62;  // quadrants, times 2^128
  const bool round_up = fraction >> 127 != 0;
  if (round_up) {
    fraction = ~fraction + 1;
    ++quadrant;
  }
  // The first 53 bits of the fraction and the next 53, as doubles.
  const auto upper = static_cast<std::uint64_t>(fraction >> 64);
  const int zeros = std::countl_zero(upper);  // at most 62: no double is closer to a quadrant
  const U128 normal = fraction << zeros;
  const double high = static_cast<double>(static_cast<std::int64_t>(normal >> 75));
  const double low_part = static_cast<double>(
      static_cast<std::int64_t>(static_cast<std::uint64_t>(normal >> 22) & 0x1fffffffffffffULL));
  const double scale = power_of_two(-53 - zeros);
  const double a = high * scale, b = low_part * scale * 0x1p-53;
  ReducedAngle r{};
  r.high = a * kHalfPi;
  r.low = std::fma(a, kHalfPi, -r.high) + (a * kHalfPiLow + b * kHalfPi);
  const bool negative = (bits >> 63 != 0) != round_up;
  if (negative) r = {-r.high, -r.low, 0};
  r.quadrant = (bits >> 63 != 0 ? -quadrant : quadrant) & 3;
  return r;
}

}  // namespace tessera::render::elementary
