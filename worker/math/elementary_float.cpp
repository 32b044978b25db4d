#include <cmath>
#include <limits>

#include "worker/math/elementary.h"
#include "worker/math/elementary_kernels.h"

// Polynomials are Taylor series, truncated where the next term is below 2^-33 of the result, so
// that truncation adds at most 0.002 ulp of float to the half ulp of the final rounding.

namespace tessera::render::elementary {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

struct ShortAngle {
  double angle;  // in [-pi/4, pi/4], relative error 2^-44
  int quadrant;
};

/// Requires finite x. For |x| < 2^20 no float is closer than 2^-30 to a multiple of pi/2, so the
/// two parts of pi/2, with an error of 2^-90 here, leave a relative error of 2^-52.
ShortAngle reduce(float x) {
  const double wide = x;
  if (std::fabs(wide) > kCodyWaiteLimit) {
    const ReducedAngle r = reduce_huge_angle(wide);
    return {r.high, r.quadrant};
  }
  const double n = std::floor(std::fma(wide, kTwoOverPi, 0.5));
  const double first = std::fma(-n, kHalfPi, wide);
  return {std::fma(-n, kHalfPiLow, first), static_cast<int>(n) & 3};
}

double sin_polynomial(double a) {
  constexpr double kC[] = {-1.0 / 6, 1.0 / 120, -1.0 / 5040, 1.0 / 362880, -1.0 / 39916800};
  const double z = a * a;
  return std::fma(a * z, horner(kC, z), a);
}

double cos_polynomial(double a) {
  constexpr double kC[] = {1.0,         -1.0 / 2,       1.0 / 24,       -1.0 / 720,
                           1.0 / 40320, -1.0 / 3628800, 1.0 / 479001600};
  return horner(kC, a * a);
}

SinCosd sincos_wide(float x) {
  const ShortAngle r = reduce(x);
  const double s = sin_polynomial(r.angle), c = cos_polynomial(r.angle);
  return rotate_quadrants(s, c, r.quadrant);
}

/// e^x in double, with a relative error of 2^-33. Requires |x| <= 110.
double exp_wide(double x) {
  constexpr double kC[] = {1.0,       1.0,       1.0 / 2,    1.0 / 6,     1.0 / 24,
                           1.0 / 120, 1.0 / 720, 1.0 / 5040, 1.0 / 40320, 1.0 / 362880};
  const double n = std::floor(std::fma(x, kInvLn2, 0.5));
  const double r = std::fma(-n, kLn2, x);
  return horner(kC, r) * power_of_two(static_cast<int>(n));
}

/// log(1 + f) with a relative error of 2^-36. Requires -0.3 <= f <= 0.42.
double log1p_series(double f) {
  constexpr double kC[] = {2.0, 2.0 / 3, 2.0 / 5, 2.0 / 7, 2.0 / 9, 2.0 / 11, 2.0 / 13};
  const double s = f / (2 + f);
  return s * horner(kC, s * s);
}

/// Requires finite x > 0.
double log_wide(double x) {
  const LogSplit split = split_for_log(x);
  return std::fma(static_cast<double>(split.exponent), kLn2, log1p_series(split.fraction));
}

/// Angle of (x, y) in double, with a relative error of 2^-36. Requires arguments within the range
/// of magnitudes of float.
double atan2_wide(double y, double x) {
  constexpr double kC[] = {-1.0 / 3, 1.0 / 5, -1.0 / 7, 1.0 / 9};
  const auto [small, large, steep] = atan_sides(y, x);
  const double index = std::floor(std::fma(small / large, 8.0, 0.5));
  const double c = index * 0.125;
  const double a = std::fma(-c, large, small) / std::fma(c, small, large);
  const double z = a * a;
  double angle = kAtanEighth[static_cast<int>(index)] + std::fma(a * z, horner(kC, z), a);
  if (steep) angle = kHalfPi - angle;
  if (std::signbit(x)) angle = kPi - angle;
  return std::copysign(angle, y);
}

}  // namespace

SinCosf sincos(float x) {
  if (!std::isfinite(x)) return {kNan, kNan};
  if (x == 0) return {x, 1};
  const SinCosd r = sincos_wide(x);
  return {static_cast<float>(r.sin), static_cast<float>(r.cos)};
}

float sin(float x) {
  return sincos(x).sin;
}

float cos(float x) {
  return sincos(x).cos;
}

float tan(float x) {
  if (!std::isfinite(x)) return kNan;
  if (x == 0) return x;
  const SinCosd r = sincos_wide(x);
  return static_cast<float>(r.sin / r.cos);
}

float exp(float x) {
  if (std::isnan(x)) return x;
  if (x > 89) return kInf;
  if (x < -110) return 0;
  return static_cast<float>(exp_wide(x));
}

float expm1(float x) {
  if (std::isnan(x) || x == 0) return x;
  if (x > 89) return kInf;
  if (x < -110) return -1;
  if (std::fabs(x) > 0.35f) return static_cast<float>(exp_wide(x) - 1);
  constexpr double kC[] = {1.0,       1.0 / 2,    1.0 / 6,     1.0 / 24,    1.0 / 120,
                           1.0 / 720, 1.0 / 5040, 1.0 / 40320, 1.0 / 362880};
  const double wide = x;
  return static_cast<float>(wide * horner(kC, wide));
}

float log(float x) {
  if (x > 0 && x < kInf) return static_cast<float>(log_wide(x));
  if (x == 0) return -kInf;
  return x < 0 ? kNan : x;
}

float log1p(float x) {
  if (std::isnan(x) || x == 0 || x == kInf) return x;
  if (x <= -1) return x == -1 ? -kInf : kNan;
  const double wide = x;
  if (wide > -0.25 && wide < 0.25) return static_cast<float>(log1p_series(wide));
  return static_cast<float>(log_wide(1 + wide));
}

float pow(float x, float y) {
  if (y == 0 || x == 1) return 1;
  if (std::isnan(x) || std::isnan(y) || x < 0) return kNan;
  if (x == 0) return y > 0 ? 0 : kInf;
  if (x == kInf) return y > 0 ? kInf : 0;
  const double t = static_cast<double>(y) * log_wide(x);
  if (t > 89) return kInf;
  if (t < -110) return 0;
  return static_cast<float>(exp_wide(t));
}

float atan2(float y, float x) {
  if (std::isnan(x) || std::isnan(y)) return kNan;
  return static_cast<float>(atan2_wide(y, x));
}

float acos(float x) {
  if (!(x >= -1 && x <= 1)) return kNan;
  const double wide = x;
  return static_cast<float>(atan2_wide(std::sqrt((1 - wide) * (1 + wide)), wide));
}

float asin(float x) {
  if (!(x >= -1 && x <= 1)) return kNan;
  const double wide = x;
  return static_cast<float>(atan2_wide(wide, std::sqrt((1 - wide) * (1 + wide))));
}

}  // namespace tessera::render::elementary
