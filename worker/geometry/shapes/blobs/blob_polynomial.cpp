#include "worker/geometry/shapes/blobs/blob_polynomial.h"

#include <cmath>
#include <cstddef>

namespace tessera::render {

/// With e the centre of the box and g half its size, both in the space in which the blob is the
/// unit sphere, 1 - r^2 is 1 - e.e - 2 e.g.x - g.g.x.x.
void BlobPolynomial::add(const UnitBlob& blob, const Vec3d& centre, const Vec3d& half) {
  const Vec3d e = (centre - blob.centre) * blob.scale, g = half * blob.scale;
  const Features w = {1 - dot(e, e), -2 * e.x * g.x, -2 * e.y * g.y, -2 * e.z * g.z,
                      -g.x * g.x,    -g.y * g.y,     -g.z * g.z};
  for (std::size_t i = 0; i < 7; ++i) {
    const double scaled = blob.strength * w[i];
    for (std::size_t j = 0; j < 8; ++j) rows_[i][j] += scaled * w[j];
  }
}

/// With x = m + y / 2, x^2 is m^2 + m y + y^2 / 4; m is 1/2 or -1/2.
void BlobPolynomial::take_half(int axis, bool upper) {
  const double m = upper ? 0.5 : -0.5;
  const std::size_t linear = 1 + static_cast<std::size_t>(axis), square = linear + 3;
  const auto replace = [m](double& one, double& x, double& xx) {
    one += m * x + 0.25 * xx;
    x = 0.5 * x + m * xx;
    xx *= 0.25;
  };
  for (Features& row : rows_) replace(row[0], row[linear], row[square]);
  for (std::size_t j = 0; j < 7; ++j) replace(rows_[0][j], rows_[linear][j], rows_[square][j]);
}

/// Bounds each monomial: from -1 to 1, or from 0 to 1 if all its powers are even.
FieldRange BlobPolynomial::range() const {
  FieldRange out;
  double odd = 0;
  const auto& m = rows_;
  for (std::size_t i = 1; i < 4; ++i) {
    out.add(2 * m[0][i + 3] + m[i][i]);
    out.add(m[i + 3][i + 3]);
    odd += std::fabs(m[0][i]) + std::fabs(m[i][i + 3]);
    for (std::size_t j = 1; j < 4; ++j) {
      if (i < j) {
        odd += std::fabs(m[i][j]);
        out.add(2 * m[i + 3][j + 3]);
      }
      if (i != j) odd += std::fabs(m[i][j + 3]);
    }
  }
  return {m[0][0] + out.low - 2 * odd, m[0][0] + out.high + 2 * odd};
}

double BlobPolynomial::product(const Features& a, const Features& b) {
  double sum = 0;
  for (std::size_t i = 0; i < 7; ++i) sum += a[i] * b[i];
  return sum;
}

BlobPolynomial::Features BlobPolynomial::times(const Features& v) const {
  Features out{};
  for (std::size_t i = 0; i < 7; ++i) {
    for (std::size_t j = 0; j < 8; ++j) out[j] += rows_[i][j] * v[i];
  }
  return out;
}

/// The features are quadratics with the Bernstein coefficients (1, p, p.p), (1, (p + q) / 2, p.q)
/// and (1, q, q.q), component by component.
BernsteinQuartic BlobPolynomial::along(const Vec3d& p, const Vec3d& q) const {
  const auto features = [](const Vec3d& x, const Vec3d& xx) {
    return Features{1, x.x, x.y, x.z, xx.x, xx.y, xx.z};
  };
  const Features start = features(p, p * p), middle = features((p + q) * 0.5, p * q),
                 end = features(q, q * q);
  const Features from_start = times(start), from_middle = times(middle), from_end = times(end);
  return {product(start, from_start), product(middle, from_start),
          (product(end, from_start) + 2 * product(middle, from_middle)) / 3,
          product(middle, from_end), product(end, from_end)};
}

Vec3d BlobPolynomial::gradient(const Vec3d& p) const {
  const Features at = {1, p.x, p.y, p.z, p.x * p.x, p.y * p.y, p.z * p.z};
  const Features v = times(at);
  return (Vec3d{v[1], v[2], v[3]} + p * Vec3d{v[4], v[5], v[6]} * 2.0) * 2.0;
}

}  // namespace tessera::render
