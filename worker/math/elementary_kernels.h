#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "worker/math/elementary.h"

/// Constants and steps shared by elementary_float.cpp, elementary_double.cpp and huge_angle.cpp.
namespace tessera::render::elementary {

inline constexpr double kPi = 0x1.921fb54442d18p+1, kPiLow = 0x1.1a62633145c07p-53;
inline constexpr double kHalfPi = 0x1.921fb54442d18p+0, kHalfPiLow = 0x1.1a62633145c07p-54;
inline constexpr double kHalfPiLowest = -0x1.f1976b7ed8fbcp-110;  // pi/2 to 160 bits in three parts
inline constexpr double kTwoOverPi = 0x1.45f306dc9c883p-1;
inline constexpr double kLn2 = 0x1.62e42fefa39efp-1, kLn2Low = 0x1.abc9e3b39803fp-56;
inline constexpr double kInvLn2 = 0x1.71547652b82fep+0;
inline constexpr double kSqrt2 = 0x1.6a09e667f3bcdp+0;

/// atan(i / 8) as high and low parts, i in [0, 8].
inline constexpr double kAtanEighth[9] = {0,
                                          0x1.fd5ba9aac2f6ep-4,
                                          0x1.f5b75f92c80ddp-3,
                                          0x1.6f61941e4def1p-2,
                                          0x1.dac670561bb4fp-2,
                                          0x1.1e00babdefeb4p-1,
                                          0x1.4978fa3269ee1p-1,
                                          0x1.700a7c5784634p-1,
                                          0x1.921fb54442d18p-1};
inline constexpr double kAtanEighthLow[9] = {0,
                                             -0x1.cd37686760c17p-59,
                                             0x1.8ab6e3cf7afbdp-57,
                                             -0x1.c63aae6f6e918p-56,
                                             0x1.a2b7f222f65e2p-56,
                                             -0x1.928df287a668fp-58,
                                             0x1.2419a87f2a458p-56,
                                             -0x1.8c34d25aadef6p-56,
                                             0x1.1a62633145c07p-55};

/// c[0] + c[1] x + ..., one fma per coefficient.
template <std::size_t N>
inline double horner(const double (&c)[N], double x) {
  double sum = c[N - 1];
  for (std::size_t i = N - 1; i-- > 0;) sum = std::fma(sum, x, c[i]);
  return sum;
}

/// 2^e. Requires -1022 <= e <= 1023.
inline double power_of_two(int e) {
  return std::bit_cast<double>(static_cast<std::uint64_t>(e + 1023) << 52);
}

/// x - quadrant * pi/2 = high + low, |high| <= pi/4 (1 + 2^-40); quadrant modulo 4.
struct ReducedAngle {
  double high, low;
  int quadrant;
};

/// Sine and cosine of an angle from those of the reduced angle.
inline SinCosd rotate_quadrants(double sin, double cos, int quadrant) {
  switch (quadrant) {
    case 0:
      return {sin, cos};
    case 1:
      return {cos, -sin};
    case 2:
      return {-sin, -cos};
    default:
      return {-cos, sin};
  }
}

/// The sides of a right triangle for atan2(y, x): small <= large, both finite, large > 0.
struct AtanSides {
  double small, large;
  bool steep;  // whether |y| > |x|
};
inline AtanSides atan_sides(double y, double x) {
  double small = std::fabs(y), large = std::fabs(x);
  const bool steep = small > large;
  if (steep) {
    const double t = small;
    small = large;
    large = t;
  }
  if (large == std::numeric_limits<double>::infinity()) {
    small = small == large ? 1 : 0;
    large = 1;
  }
  if (large == 0) large = 1;
  return {small, large, steep};
}

/// Largest |x| for three-part Cody-Waite reduction; larger arguments use reduce_huge_angle().
inline constexpr double kCodyWaiteLimit = 0x1p20;

/// Payne and Hanek's reduction, with a relative error of 2^-70. Requires finite |x| >= 1.
/// Source: Payne & Hanek, "Radian reduction for trigonometric functions", SIGNUM 1983.
ReducedAngle reduce_huge_angle(double x);

/// x = 2^exponent * (1 + fraction), with 1 + fraction in [sqrt(1/2), sqrt(2)). Requires x > 0,
/// finite. `fraction` is exact.
struct LogSplit {
  int exponent;
  double fraction;
};
inline LogSplit split_for_log(double x) {
  int bias = 1023;
  if (x < 0x1p-1022) {
    x *= 0x1p54;
    bias += 54;
  }
  const auto bits = std::bit_cast<std::uint64_t>(x);
  int exponent = static_cast<int>(bits >> 52) - bias;
  double m = std::bit_cast<double>((bits & 0xfffffffffffffULL) | 0x3ff0000000000000ULL);
  if (m >= kSqrt2) {
    m *= 0.5;
    ++exponent;
  }
  return {exponent, m - 1};
}

}  // namespace tessera::render::elementary
