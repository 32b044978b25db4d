#include "worker/geometry/shapes/terrain/terrain_field.h"

#include <algorithm>
#include <cmath>

#include "worker/math/elementary.h"
#include "worker/math/float_bits.h"

namespace tessera::render {
namespace {

constexpr double kTwoPi = 6.28318530717958647692;
/// Bound of the second derivative of sin(2 pi x) cos(2 pi z) in any direction: it is the mean of
/// two sines along the diagonals.
constexpr double kWaveCurvature = kTwoPi * kTwoPi;
/// Depth limit of the quadtree: 256 by 256 cells.
constexpr int kDeepest = 8;
/// An octave is in [-1, 1]; bounds with an error from here on are not worth evaluating.
constexpr double kUnresolved = 0.75;

NoiseSlope wave_slope(const Vec2d& p) {
  const auto [sx, cx] = elementary::sincos(kTwoPi * (p.x - std::floor(p.x)));
  const auto [sz, cz] = elementary::sincos(kTwoPi * (p.y - std::floor(p.y)));
  return {sx * cz, kTwoPi * cx * cz, -kTwoPi * sx * sz};
}

template <std::size_t N>
double squares(const std::array<Vec2d, N>& spans) {
  double sum = 0;
  for (const Vec2d& span : spans) sum += span.x * span.x + span.y * span.y;
  return sum;
}

}  // namespace

TerrainField::TerrainField(const TerrainForm& form) : form_(form) {
  // The coordinates of an octave have a few rounding errors; the error of its value is those times
  // the largest slope (2.93 for noise, 2 pi for waves), doubled where it is squared. A ridge is
  // weighted by twice the previous one, including its error.
  const bool ridged = form.pattern == TerrainForm::Pattern::ridged;
  double farthest = 0.5 * form.scale * (form.size.x + form.size.y) + std::fabs(form.offset.x) +
                    std::fabs(form.offset.y);
  double amplitude = 1, error = 0, errors = 0;
  finest_ = form.octaves > 0 ? 1 / form.scale : std::max(form.size.x, form.size.y);
  for (std::int32_t i = 0; i < form.octaves; ++i) {
    if (i > 0) finest_ /= form.lacunarity;
    error = (ridged ? 2 * error : 0) + 0x1p-48 + 8 * farthest * (i + 6) * 0x1p-53;
    errors += amplitude * error;
    amplitudes_ += amplitude;
    amplitude *= form.gain;
    farthest *= form.lacunarity;
  }
  const double share = amplitudes_ > 0 ? form.height / amplitudes_ : 0;
  rounding_ = form.height * 0x1p-48 + errors * share;
  to_height_ = ridged ? share : 0.5 * share;
  base_ = ridged ? 0 : 0.5 * form.height;
  const double across = 2 * std::max(form.size.x, form.size.y) / finest_;
  int deepest = 0;
  while (deepest < kDeepest && static_cast<double>(1 << deepest) < across) ++deepest;
  build_levels(deepest);
}

/// Computes the ranges of all levels, the deepest first.
void TerrainField::build_levels(int deepest) {
  levels_.resize(static_cast<std::size_t>(deepest) + 1);
  TerrainCells cells;
  for (int level = deepest; level >= 0; --level) {
    const std::size_t n = std::size_t{1} << level;
    auto& ranges = levels_[static_cast<std::size_t>(level)];
    ranges.resize(n * n);
    const Vec2d half = form_.size * (0.5 / static_cast<double>(n));
    for (std::size_t i = 0; i < n * n; ++i) {
      const std::size_t row = i / n, column = i % n;
      Range& here = ranges[i];
      if (level == deepest) {
        here = range_of_cell({(2 * static_cast<double>(column) + 1) * half.x - 0.5 * form_.size.x,
                              (2 * static_cast<double>(row) + 1) * half.y - 0.5 * form_.size.y},
                             half, cells);
        continue;
      }
      here = range(level + 1, 2 * column, 2 * row);
      for (const std::size_t k : {1, 2, 3}) {
        const Range& part = range(level + 1, 2 * column + k % 2, 2 * row + k / 2);
        here.low = std::min(here.low, part.low);
        here.high = std::max(here.high, part.high);
      }
    }
  }
}

/// The range of a deepest cell, from the bounds of its quarters.
TerrainField::Range TerrainField::range_of_cell(const Vec2d& middle, const Vec2d& half,
                                                TerrainCells& cells) const {
  double low = form_.height + rounding_, high = -rounding_;  // an empty range
  for (const double x : {-0.5, 0.5}) {
    for (const double z : {-0.5, 0.5}) {
      const AffineForm<2> part =
          heights<2>({middle.x + x * half.x, middle.y + z * half.y},
                     {Vec2d{0.5 * half.x, 0}, Vec2d{0, 0.5 * half.y}}, cells);
      low = std::min(low, part.low());
      high = std::max(high, part.high());
    }
  }
  low = std::max(low, -rounding_);
  high = std::min(high, form_.height + rounding_);
  return {next_down(static_cast<float>(low)), next_up(static_cast<float>(high))};
}

double TerrainField::spot_at(const Vec2d& at) const {
  const Vec3d to = Vec3d{at.x, 0, at.y} - form_.seen_from;
  return form_.spot_angle * std::sqrt(dot(to, to));
}

double TerrainField::precision(const Vec2d& at) const {
  return std::max(0.5 * spot_at(at), finest_ * 0x1p-10);
}

double TerrainField::height(const Vec2d& at) const {
  TerrainCells cells;
  return heights_until<0>(at, {}, cells, [](const AffineForm<0>&) { return false; }).centre;
}

Vec2d TerrainField::slope(const Vec2d& at) const {
  const double span = finest_ * 0x1p-20;
  TerrainCells cells;
  const AffineForm<2> around = heights<2>(at, {Vec2d{span, 0}, Vec2d{0, span}}, cells);
  return {around.slope[0] / span, around.slope[1] / span};
}

/// Bounds of the size of the smallest resolved detail, in features.
template <std::size_t N>
AffineForm<N> TerrainField::spots(const Vec2d& at, const std::array<Vec2d, N>& spans) const {
  AffineForm<N> spot;
  if (!(form_.spot_angle > 0)) return spot;
  const Vec3d to = Vec3d{at.x, 0, at.y} - form_.seen_from;
  const double distance = std::sqrt(dot(to, to)), reach2 = squares(spans);
  const double reach = std::sqrt(reach2);
  spot.centre = distance;
  spot.error = reach;
  if (distance > 2 * reach) {  // to first order; the second derivative is at most 1 / distance
    for (std::size_t k = 0; k < N; ++k) {
      spot.slope[k] = (to.x * spans[k].x + to.z * spans[k].y) / distance;
    }
    spot.error = 0.5 * reach2 / (distance - reach);
  }
  return spot * (form_.spot_angle * form_.scale);
}

/// Bounds of an octave of the pattern, in [-1, 1]; `at` and `spans` are in its features.
/// First-order around the middle; `error` bounds the second-order term.
template <std::size_t N>
AffineForm<N> TerrainField::octave(const Vec2d& at, const std::array<Vec2d, N>& spans, double error,
                                   std::int32_t number, TerrainCells& cells) const {
  const NoiseSlope here =
      form_.pattern == TerrainForm::Pattern::waves
          ? wave_slope(at)
          : gradient_noise_slope({at.x, at.y}, form_.seed + static_cast<std::uint32_t>(number),
                                 cells[static_cast<std::size_t>(number)]);
  AffineForm<N> out;
  out.centre = here.value;
  out.error = error;
  for (std::size_t k = 0; k < N; ++k) out.slope[k] = here.dx * spans[k].x + here.dy * spans[k].y;
  return out;
}

/// Returns bounds of the height. After each octave, `enough(bounds)` decides whether the bounds so
/// far suffice.
template <std::size_t N, typename Enough>
AffineForm<N> TerrainField::heights_until(const Vec2d& at, const std::array<Vec2d, N>& spans,
                                          TerrainCells& cells, const Enough& enough) const {
  const bool ridged = form_.pattern == TerrainForm::Pattern::ridged;
  constexpr double kMean = double{kMeanRidgedNoise[2]};
  const double curvature =
      form_.pattern == TerrainForm::Pattern::waves ? kWaveCurvature : kNoiseCurvature;
  Vec2d p = at * form_.scale + form_.offset;
  std::array<Vec2d, N> reach;
  for (std::size_t k = 0; k < N; ++k) reach[k] = spans[k] * form_.scale;
  AffineForm<N> spot = spots(at, spans);
  double error = 0.5 * curvature * squares(reach);

  // Bounds of the height from the sum of the octaves so far, with `open` as the sum of the
  // remaining amplitudes: the rest is in [0, open] for a ridged pattern, else in [-open, open].
  const auto known = [&](AffineForm<N> sum, double open) {
    if (ridged) sum.centre += 0.5 * open;
    sum.error += ridged ? 0.5 * open : open;
    sum = sum * to_height_ + base_;
    sum.error += rounding_;
    return sum;
  };
  AffineForm<N> sum, weight;
  weight.centre = 1;
  double amplitude = 1, open = amplitudes_;
  for (std::int32_t i = 0; i < form_.octaves; ++i) {
    const bool whole = spot.high() <= 0.5, hidden = spot.low() >= 1;
    if (hidden) {
      if (!ridged) break;
      weight = weight * kMean;
      sum = sum + weight * amplitude;
    } else {
      if (error >= kUnresolved) return known(sum, open);  // finer octaves have larger errors
      AffineForm<N> wave = octave<N>(p, reach, error, i, cells);
      if (ridged) wave = squared(absolute(wave) * -1 + 1);
      if (!whole) {
        const double mean = ridged ? kMean : 0;
        wave = at_least(at_most(spot * -2 + 2, 1), 0) * (wave + -mean) + mean;
      }
      if (ridged) {
        weight = i > 0 ? weight * wave : wave;
        wave = weight;
      }
      sum = sum + wave * amplitude;
    }
    open -= amplitude;
    if (i + 1 == form_.octaves) break;
    const AffineForm<N> so_far = known(sum, open + 0x1p-40);  // covers the rounding of `open`
    if (enough(so_far)) return so_far;
    if (ridged) weight = at_most(weight * 2, 1);
    amplitude *= form_.gain;
    p = p * form_.lacunarity;
    for (Vec2d& span : reach) span = span * form_.lacunarity;
    error *= form_.lacunarity * form_.lacunarity;
    spot = spot * form_.lacunarity;
  }
  return known(sum, 0);
}

template <std::size_t N>
AffineForm<N> TerrainField::heights(const Vec2d& at, const std::array<Vec2d, N>& spans,
                                    TerrainCells& cells) const {
  return heights_until(at, spans, cells, [](const AffineForm<N>&) { return false; });
}

template <std::size_t N>
AffineForm<N> TerrainField::clearance(const AffineForm<N>& y, const Vec2d& at,
                                      const std::array<Vec2d, N>& spans,
                                      TerrainCells& cells) const {
  const auto above = [&y](const AffineForm<N>& ground) { return y + ground * -1; };
  return above(heights_until(at, spans, cells, [&](const AffineForm<N>& ground) {
    const AffineForm<N> left = above(ground);
    return std::fabs(left.centre) > left.reach();
  }));
}

template AffineForm<1> TerrainField::heights(const Vec2d&, const std::array<Vec2d, 1>&,
                                             TerrainCells&) const;
template AffineForm<2> TerrainField::heights(const Vec2d&, const std::array<Vec2d, 2>&,
                                             TerrainCells&) const;
template AffineForm<0> TerrainField::clearance(const AffineForm<0>&, const Vec2d&,
                                               const std::array<Vec2d, 0>&, TerrainCells&) const;
template AffineForm<1> TerrainField::clearance(const AffineForm<1>&, const Vec2d&,
                                               const std::array<Vec2d, 1>&, TerrainCells&) const;

}  // namespace tessera::render
