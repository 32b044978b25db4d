#include <cmath>
#include <limits>

#include "worker/math/elementary.h"
#include "worker/math/elementary_kernels.h"

// Polynomials are Taylor series, truncated where the next term is below 2^-54 of the result.

namespace tessera::render::elementary {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

/// An unevaluated sum, with |low| about ulp(high) / 2 at most.
struct Pair {
  double high, low;
};

/// a + b exactly, in any order of magnitudes. Source: Knuth, TAOCP 2, 4.2.2.
Pair two_sum(double a, double b) {
  const double sum = a + b;
  const double part = sum - a;
  return {sum, (a - (sum - part)) + (b - part)};
}

/// Requires finite x.
ReducedAngle reduce(double x) {
  if (std::fabs(x) > kCodyWaiteLimit) return reduce_huge_angle(x);
  const double n = std::floor(std::fma(x, kTwoOverPi, 0.5));
  // Exact: the difference is a multiple of 2^-53 below 1.
  const double first = std::fma(-n, kHalfPi, x);
  const double product = n * kHalfPiLow;
  const double product_low = std::fma(n, kHalfPiLow, -product) + n * kHalfPiLowest;
  const Pair sum = two_sum(first, -product);
  const double high = sum.high + (sum.low - product_low);
  return {high, (sum.high - high) + (sum.low - product_low), static_cast<int>(n) & 3};
}

double sin_polynomial(double a, double low) {
  constexpr double kC[] = {
      -1.0 / 6,        1.0 / 120,        -1.0 / 5040,          1.0 / 362880,
      -1.0 / 39916800, 1.0 / 6227020800, -1.0 / 1307674368000, 1.0 / 355687428096000};
  const double z = a * a;
  const double tail = std::fma(low, std::fma(z, -0.5, 1.0), a * z * horner(kC, z));
  return a + tail;
}

double cos_polynomial(double a, double low) {
  constexpr double kC[] = {1.0 / 24,        -1.0 / 720,         1.0 / 40320,         -1.0 / 3628800,
                           1.0 / 479001600, -1.0 / 87178291200, 1.0 / 20922789888000};
  const double z = a * a;
  const double half = 0.5 * z;
  const double head = 1 - half;
  // The rounding error of 1 - half, the rest of the series, and the derivative times `low`.
  return head + (((1 - head) - half) + std::fma(z * z, horner(kC, z), -a * low));
}

/// e^(x + low) for |low| << 1, as 2^n e^r. 2^n is two exact factors, so that neither overflows.
double exp_of(double x, double low) {
  constexpr double kC[] = {1.0 / 2,       1.0 / 6,        1.0 / 24,        1.0 / 120,
                           1.0 / 720,     1.0 / 5040,     1.0 / 40320,     1.0 / 362880,
                           1.0 / 3628800, 1.0 / 39916800, 1.0 / 479001600, 1.0 / 6227020800};
  const double n = std::floor(std::fma(x, kInvLn2, 0.5));
  const double r = std::fma(-n, kLn2Low, std::fma(-n, kLn2, x)) + low;
  const double value = 1 + std::fma(r * r, horner(kC, r), r);
  const int half = static_cast<int>(n) / 2;
  return value * power_of_two(half) * power_of_two(static_cast<int>(n) - half);
}

/// 2 (s^3/3 + s^5/5 + ...): the terms after 2s of log((1 + s)/(1 - s)). Requires |s| < 0.172.
double atanh_tail(double s) {
  constexpr double kC[] = {2.0 / 3,  2.0 / 5,  2.0 / 7,  2.0 / 9,  2.0 / 11,
                           2.0 / 13, 2.0 / 15, 2.0 / 17, 2.0 / 19, 2.0 / 21};
  const double z = s * s;
  return s * z * horner(kC, z);
}

/// log x with a relative error of about 2^-60. Requires finite x > 0.
Pair log_pair(double x) {
  const LogSplit split = split_for_log(x);
  const double f = split.fraction, e = split.exponent;
  const Pair denominator = two_sum(2, f);
  const double s = f / denominator.high;
  const double s_low = (std::fma(-s, denominator.high, f) - s * denominator.low) / denominator.high;
  const double scaled = e * kLn2;
  const double scaled_low = std::fma(e, kLn2, -scaled) + e * kLn2Low;
  const Pair a = two_sum(scaled, 2 * s);
  const Pair b = two_sum(a.high, atanh_tail(s));
  return {b.high, b.low + (a.low + (scaled_low + 2 * s_low))};
}

double atan2_finite(double y, double x) {
  constexpr double kC[] = {-1.0 / 3, 1.0 / 5, -1.0 / 7, 1.0 / 9, -1.0 / 11, 1.0 / 13};
  const AtanSides sides = atan_sides(y, x);
  const bool steep = sides.steep;
  double small = sides.small, large = sides.large;
  const double scale = large > 0x1p1000 ? 0x1p-200 : large < 0x1p-800 ? 0x1p200 : 1.0;
  small *= scale;
  large *= scale;
  const double index = std::floor(std::fma(small / large, 8.0, 0.5));
  const double c = index * 0.125;
  const double a = std::fma(-c, large, small) / std::fma(c, small, large);
  const double z = a * a;
  const int i = static_cast<int>(index);
  Pair angle = {kAtanEighth[i], kAtanEighthLow[i] + a * z * horner(kC, z)};
  const Pair sum = two_sum(angle.high, a);
  angle = {sum.high, sum.low + angle.low};
  if (steep) {
    const Pair rest = two_sum(kHalfPi, -angle.high);
    angle = {rest.high, rest.low + (kHalfPiLow - angle.low)};
  }
  if (std::signbit(x)) {
    const Pair rest = two_sum(kPi, -angle.high);
    angle = {rest.high, rest.low + (kPiLow - angle.low)};
  }
  return std::copysign(angle.high + angle.low, y);
}

}  // namespace

SinCosd sincos(double x) {
  if (!std::isfinite(x)) return {kNan, kNan};
  if (x == 0) return {x, 1};
  const ReducedAngle r = reduce(x);
  const double s = sin_polynomial(r.high, r.low), c = cos_polynomial(r.high, r.low);
  return rotate_quadrants(s, c, r.quadrant);
}

double sin(double x) {
  return sincos(x).sin;
}

double cos(double x) {
  return sincos(x).cos;
}

double tan(double x) {
  if (x == 0) return x;
  const SinCosd r = sincos(x);
  return r.sin / r.cos;
}

double exp(double x) {
  if (std::isnan(x)) return x;
  if (x > 710) return kInf;
  if (x < -746) return 0;
  return exp_of(x, 0);
}

double log(double x) {
  if (!(x > 0 && x < kInf)) return x == 0 ? -kInf : x < 0 ? kNan : x;
  const LogSplit split = split_for_log(x);
  const double f = split.fraction, e = split.exponent;
  const double s = f / (2 + f);
  // log(1 + f) = f - (f^2/2 - s (f^2/2 + tail)), where f is exact.
  const double half = 0.5 * f * f;
  const double series = std::fma(s, half, atanh_tail(s));
  if (e == 0) return f - (half - series);
  return std::fma(e, kLn2, f - (half - (series + e * kLn2Low)));
}

double pow(double x, double y) {
  if (y == 0 || x == 1) return 1;
  if (std::isnan(x) || std::isnan(y) || x < 0) return kNan;
  if (x == 0) return y > 0 ? 0 : kInf;
  if (x == kInf) return y > 0 ? kInf : 0;
  const Pair l = log_pair(x);
  const double t = y * l.high;
  if (t > 710) return kInf;
  if (t < -746) return 0;
  return exp_of(t, std::fma(y, l.high, -t) + y * l.low);
}

double atan2(double y, double x) {
  if (std::isnan(x) || std::isnan(y)) return kNan;
  return atan2_finite(y, x);
}

double acos(double x) {
  if (!(x >= -1 && x <= 1)) return kNan;
  return atan2_finite(std::sqrt((1 - x) * (1 + x)), x);
}

double asin(double x) {
  if (!(x >= -1 && x <= 1)) return kNan;
  return atan2_finite(x, std::sqrt((1 - x) * (1 + x)));
}

}  // namespace tessera::render::elementary
