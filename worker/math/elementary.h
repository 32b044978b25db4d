#pragma once

namespace tessera::render::elementary {

/// The functions that libm would give, but with the same bits on every machine and from every
/// compiler: + - * / sqrt, fma, floor and conversions only ("The bits", rule 4).
///
/// Float versions work inside double: at most 0.502 ulp, over the whole domain (denormal results
/// included). Double versions: bounds beside each, in ulp of the result. NaN in, NaN out, always.

struct SinCosf {
  float sin, cos;
};
struct SinCosd {
  double sin, cos;
};

/// Radians, any finite size (arguments are reduced exactly); NaN for infinities. sin(-0) = -0.
float sin(float x);
float cos(float x);
float tan(float x);
SinCosf sincos(float x);
/// As above; sin and cos 2 ulp, tan 4 ulp.
double sin(double x);
double cos(double x);
double tan(double x);
SinCosd sincos(double x);

/// e^x: +inf from 88.73 (double: 709.79) on, 0 from -103.98 (double: -745.14) down.
float exp(float x);
/// As above; 2 ulp, results below 2^-1022 to 1 unit of 2^-1074 more.
double exp(double x);

/// e^x - 1 without cancellation; -1 at -inf, -0 at -0.
float expm1(float x);

/// Natural logarithm: -inf at 0 of either sign, NaN below, +inf at +inf.
float log(float x);
/// As above; 2 ulp.
double log(double x);

/// log(1 + x) without cancellation: -inf at -1, NaN below, -0 at -0.
float log1p(float x);

/// x^y for x >= 0; NaN for x < 0, whatever y (-0 counts as 0). x^0 = 1^y = 1, also for NaN.
/// 0^y is 0 for y > 0 and +inf for y < 0.
float pow(float x, float y);
/// As above; 4 ulp while |y log x| <= 32, 20 ulp up to the overflow and underflow limits.
double pow(double x, double y);

/// Angle of (x, y) in [-pi, pi], signs of zeros and infinities as in IEEE 754's atan2.
float atan2(float y, float x);
/// As above; 3 ulp.
double atan2(double y, double x);

/// In [0, pi]; NaN outside [-1, 1].
float acos(float x);
/// As above; 4 ulp.
double acos(double x);

/// In [-pi/2, pi/2]; NaN outside [-1, 1]. asin(-0) = -0.
float asin(float x);
/// As above; 4 ulp.
double asin(double x);

}  // namespace tessera::render::elementary
