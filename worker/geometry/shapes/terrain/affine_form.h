#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace tessera::render {

/// Linear bounds of a function over a region: its value at the position s, s[k] in [-1, 1], is
/// centre + sum of slope[k] s[k], with an error of at most `error`. With N = 0 the region is a
/// point. Operations preserve the bounds up to rounding; those of one variable are optimal among
/// linear bounds.
/// Source: J. Stolfi, L. H. de Figueiredo, "Self-validated numerical methods and applications",
/// 1997, chapter 3, with a single term for all errors.
template <std::size_t N>
struct AffineForm {
  double centre = 0;
  std::array<double, N> slope{};
  double error = 0;

  double reach() const {
    double sum = error;
    for (const double s : slope) sum += std::fabs(s);
    return sum;
  }
  double low() const { return centre - reach(); }
  double high() const { return centre + reach(); }
};

template <std::size_t N>
inline __attribute__((always_inline)) AffineForm<N> operator+(AffineForm<N> a, double b) {
  a.centre += b;
  return a;
}

template <std::size_t N>
inline __attribute__((always_inline)) AffineForm<N> operator*(AffineForm<N> a, double b) {
  a.centre *= b;
  for (double& s : a.slope) s *= b;
  a.error *= std::fabs(b);
  return a;
}

template <std::size_t N>
inline __attribute__((always_inline)) AffineForm<N> operator+(AffineForm<N> a,
                                                              const AffineForm<N>& b) {
  a.centre += b.centre;
  for (std::size_t k = 0; k < N; ++k) a.slope[k] += b.slope[k];
  a.error += b.error;
  return a;
}

template <std::size_t N>
inline __attribute__((always_inline)) AffineForm<N> operator*(const AffineForm<N>& a,
                                                              const AffineForm<N>& b) {
  AffineForm<N> out;
  const double reach_a = a.reach(), reach_b = b.reach();
  out.centre = a.centre * b.centre;
  // Bounds (a - centre) (b - centre) and the errors times the centres.
  out.error = reach_a * reach_b + std::fabs(a.centre) * b.error + std::fabs(b.centre) * a.error;
  for (std::size_t k = 0; k < N; ++k) {
    out.slope[k] = a.centre * b.slope[k] + b.centre * a.slope[k];
  }
  return out;
}

/// |x|. If the sign is unknown: the line midway between the chord above the graph and its kink.
template <std::size_t N>
inline __attribute__((always_inline)) AffineForm<N> absolute(const AffineForm<N>& x) {
  const double low = x.low(), high = x.high();
  if (low >= 0) return x;
  if (high <= 0) return x * -1;
  const double rise = (high + low) / (high - low);  // slope of the chord from -low to high
  const double gap = -low * high / (high - low);    // half of the chord's value at 0
  AffineForm<N> out = x * rise + gap;
  out.error += gap;
  return out;
}

/// min(x, limit). If it is unknown which is smaller: the line midway between the kink of the graph
/// and the chord below it.
template <std::size_t N>
inline __attribute__((always_inline)) AffineForm<N> at_most(const AffineForm<N>& x, double limit) {
  const double low = x.low() - limit, high = x.high() - limit;
  if (high <= 0) return x;
  AffineForm<N> out;
  out.centre = limit;
  if (low >= 0) return out;
  const double gap = -0.5 * low * high / (high - low);
  out = (x + -limit) * (-low / (high - low)) + (limit - gap);
  out.error += gap;
  return out;
}

/// max(x, limit).
template <std::size_t N>
inline __attribute__((always_inline)) AffineForm<N> at_least(const AffineForm<N>& x, double limit) {
  return at_most(x * -1, -limit) * -1;
}

/// x^2: the line midway between the chord and the parallel tangent.
template <std::size_t N>
inline __attribute__((always_inline)) AffineForm<N> squared(const AffineForm<N>& x) {
  const double reach = x.reach(), half = 0.5 * reach * reach;
  AffineForm<N> out = x * (2 * x.centre) + (half - x.centre * x.centre);
  out.error += half;
  return out;
}

}  // namespace tessera::render
