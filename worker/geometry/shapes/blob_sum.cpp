#include <algorithm>
#include <cmath>

#include "worker/geometry/shapes/blob_line.h"

namespace tessera::render {
namespace {

/// scale (a + b x + c x^2)^2
Quartic squared(double a, double b, double c, double scale) {
  return {scale * (a * a), scale * (2 * a * b), scale * (b * b + 2 * a * c), scale * (2 * b * c),
          scale * (c * c)};
}

/// Replaces q(x) by q(x + shift), by repeated synthetic division.
void translate(Quartic& q, double shift) {
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t k = 4; k-- > i;) q[k] += shift * q[k + 1];
  }
}

}  // namespace

void BlobSum::clear(double t) {
  sum_ = error_ = {};
  t_ = t;
}

/// A coefficient of the result depends on at most 8 roundings, of values up to that coefficient of
/// the translated magnitudes; 32 u of them also covers the rounding of the error itself.
void BlobSum::move_to(double t) {
  for (std::size_t k = 0; k < 5; ++k) error_[k] += 0x1p-48 * std::fabs(sum_[k]);
  const double shift = t - t_;
  translate(sum_, shift);
  translate(error_, shift * (1 + 0x1p-50));
  t_ = t;
}

/// With s = t - nearest, 1 - |p|^2 = (1 - point.point) - 2 (point.direction) s - |direction|^2 s^2.
/// Each of its coefficients carries at most 16 u of the sum of the magnitudes of its terms, and
/// those of its square about twice that; 64 u are allowed.
void BlobSum::add(const BlobSpan& span, double sign) {
  const double s = t_ - span.nearest;
  const double square = dot(span.direction, span.direction);
  const double slope = -2 * dot(span.point, span.direction);
  // |point.direction| sums magnitudes, since the terms cancel.
  const double slope_size =
      2 * (std::fabs(span.point.x * span.direction.x) + std::fabs(span.point.y * span.direction.y) +
           std::fabs(span.point.z * span.direction.z));
  const double height = dot(span.point, span.point);
  const Quartic term = squared((1 - height) + (slope - square * s) * s, slope - 2 * square * s,
                               -square, sign * span.strength);
  const Quartic size =
      squared(1 + height + (slope_size + square * std::fabs(s)) * std::fabs(s),
              slope_size + 2 * square * std::fabs(s), square, std::fabs(span.strength));
  for (std::size_t k = 0; k < 5; ++k) {
    sum_[k] += term[k];
    error_[k] += 0x1p-47 * size[k] + 0x1p-52 * std::fabs(sum_[k]);
  }
}

bool BlobSum::stays(bool above, double t, double threshold, double margin) const {
  Quartic y;  // coefficients for distances in multiples of the interval
  double power = 1, error = margin;
  for (std::size_t k = 0; k < 5; ++k) {
    y[k] = sum_[k] * power;
    // At most 16 u for the rounding here.
    error += (2 * error_[k] + 0x1p-49 * std::fabs(sum_[k])) * power;
    power *= t - t_;
  }
  const double b[] = {y[0], y[0] + y[1] / 4, y[0] + y[1] / 2 + y[2] / 6,
                      y[0] + 0.75 * y[1] + y[2] / 2 + y[3] / 4, y[0] + y[1] + y[2] + y[3] + y[4]};
  const auto [low, high] = std::minmax({b[0], b[1], b[2], b[3], b[4]});
  return above ? low - error > threshold : high + error < threshold;
}

}  // namespace tessera::render
