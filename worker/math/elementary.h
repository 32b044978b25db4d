#pragma once

namespace tessera::render::elementary {

/// Elementary functions with the same bits on every machine and from every compiler. They use
/// + - * / sqrt, fma, floor and conversions only (docs/explanation/determinism.md#arithmetic).
///
/// Float versions compute in double; their error is at most 0.502 ulp over the whole domain,
/// denormal results included. The error bounds of double versions are given with each, in ulp of
/// the result. A NaN argument gives NaN, except where pow() says otherwise.

struct SinCosf {
  float sin, cos;
};
struct SinCosd {
  double sin, cos;
};

/// Angles in radians. Finite arguments of any size are reduced exactly; infinities give NaN.
/// sin(-0) = -0.
float sin(float x);
float cos(float x);
float tan(float x);
SinCosf sincos(float x);
/// As above; sin and cos 2 ulp, tan 4 ulp.
double sin(double x);
double cos(double x);
double tan(double x);
SinCosd sincos(double x);

/// e^x: +inf for x >= 88.73 (double: 709.79), 0 for x <= -103.98 (double: -745.14).
float exp(float x);
/// As above; 2 ulp, and for results below 2^-1022 another 2^-1074.
double exp(double x);

/// e^x - 1 without cancellation; -1 at -inf, -0 at -0.
float expm1(float x);

/// Natural logarithm: -inf at +0 and -0, NaN for x < 0, +inf at +inf.
float log(float x);
/// As above; 2 ulp.
double log(double x);

/// log(1 + x) without cancellation: -inf at -1, NaN for x < -1, -0 at -0.
float log1p(float x);

/// x^y for x >= 0. NaN for x < 0 and any y except 0; -0 counts as 0. x^0 = 1^y = 1, also for NaN.
/// 0^y is 0 for y > 0 and +inf for y < 0.
float pow(float x, float y);
/// As above; 4 ulp for |y log x| <= 32, 20 ulp up to the overflow and underflow limits.
double pow(double x, double y);

/// Angle of (x, y) in [-pi, pi]. Zeros and infinities are treated as by atan2 of IEEE 754.
float atan2(float y, float x);
/// As above; 3 ulp.
double atan2(double y, double x);

/// Result in [0, pi]; NaN outside [-1, 1].
float acos(float x);
/// As above; 4 ulp.
double acos(double x);

/// Result in [-pi/2, pi/2]; NaN outside [-1, 1]. asin(-0) = -0.
float asin(float x);
/// As above; 4 ulp.
double asin(double x);

}  // namespace tessera::render::elementary
