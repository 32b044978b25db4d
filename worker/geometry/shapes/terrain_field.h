#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "worker/geometry/shapes/affine_form.h"
#include "worker/math/vector.h"
#include "worker/sampling/gradient_noise.h"

namespace tessera::render {

using Vec2d = Vec2<double>;

/// A height field over the rectangle size.x by size.y about the origin: `height` times a pattern in
/// [0, 1] of x and z. The patterns fbm and ridged are those of TESSERA_texture.
struct TerrainForm {
  enum class Pattern : std::uint8_t {
    fbm,     // the sum of octaves of gradient noise
    ridged,  // Musgrave's multifractal: crests where noise crosses zero
    waves,   // the sum of octaves of sin(2 pi x) cos(2 pi z)
  };
  Pattern pattern = Pattern::ridged;
  Vec2d size = {1, 1};
  double height = 1;
  double scale = 1;          // features a metre
  Vec2d offset;              // in features
  std::int32_t octaves = 8;  // none: a plane
  double lacunarity = 2, gain = 0.5;
  std::uint32_t seed = 0;

  /// Detail that a spot of this angle, seen from there, does not resolve is left out: octaves of
  /// more than one feature a spot give their mean, those with less than half a feature are there
  /// in full. A property of places, not of rays, so that all rays meet one surface. 0: all detail.
  double spot_angle = 0;
  Vec3d seen_from;
};

inline constexpr std::int32_t kMaxTerrainOctaves = 24;

/// The cell of each octave's noise that was asked for last: places along a line share most.
using TerrainCells = std::array<NoiseCell, kMaxTerrainOctaves>;

/// Heights, and bounds for them. Immutable; what it changes is its caller's.
class TerrainField {
 public:
  explicit TerrainField(const TerrainForm& form);

  const TerrainForm& form() const { return form_; }

  /// What the height is within at + sum of spans[k] s[k], s[k] in [-1, 1]; spans are at right
  /// angles. True with its rounding.
  template <std::size_t N>
  AffineForm<N> heights(const Vec2d& at, const std::array<Vec2d, N>& spans,
                         TerrainCells& cells) const;

  /// What a height above y = 0, over the same places, is above the ground; worked out only until
  /// its sign is known.
  template <std::size_t N>
  AffineForm<N> clearance(const AffineForm<N>& y, const Vec2d& at,
                           const std::array<Vec2d, N>& spans, TerrainCells& cells) const;

  double height(const Vec2d& at) const;
  /// Its derivatives by x and z; across a crest, something between those of both sides.
  Vec2d slope(const Vec2d& at) const;

  /// How finely lines are looked at there: what stands out of the ground for less than that along
  /// a line may be passed by. Half a spot, or a 1024th of the finest feature.
  double precision(const Vec2d& at) const;
  /// Bounds the rounding of heights.
  double rounding() const { return rounding_; }

  struct Range {
    float low, high;
  };
  /// A quadtree of the heights: level l halves the rectangle l times along both axes.
  int levels() const { return static_cast<int>(levels_.size()); }
  const Range& range(int level, std::size_t column, std::size_t row) const {
    const std::size_t across = std::size_t{1} << level;
    return levels_[static_cast<std::size_t>(level)][row * across + column];
  }

 private:
  template <std::size_t N, typename Enough>
  AffineForm<N> heights_until(const Vec2d& at, const std::array<Vec2d, N>& spans,
                               TerrainCells& cells, const Enough& enough) const;
  template <std::size_t N>
  AffineForm<N> spots(const Vec2d& at, const std::array<Vec2d, N>& spans) const;
  template <std::size_t N>
  AffineForm<N> octave(const Vec2d& at, const std::array<Vec2d, N>& spans, double error,
                        std::int32_t number, TerrainCells& cells) const;
  double spot_at(const Vec2d& at) const;
  void build_levels(int deepest);
  Range range_of_cell(const Vec2d& middle, const Vec2d& half, TerrainCells& cells) const;

  TerrainForm form_;
  double amplitudes_ = 0;            // of all octaves
  double to_height_ = 0, base_ = 0;  // of their sum
  double finest_ = 1;                // size of the last octave's features, or of the terrain
  double rounding_ = 0;
  std::vector<std::vector<Range>> levels_;  // from the whole down
};

extern template AffineForm<1> TerrainField::heights(const Vec2d&, const std::array<Vec2d, 1>&,
                                                     TerrainCells&) const;
extern template AffineForm<2> TerrainField::heights(const Vec2d&, const std::array<Vec2d, 2>&,
                                                     TerrainCells&) const;
extern template AffineForm<0> TerrainField::clearance(const AffineForm<0>&, const Vec2d&,
                                                       const std::array<Vec2d, 0>&,
                                                       TerrainCells&) const;
extern template AffineForm<1> TerrainField::clearance(const AffineForm<1>&, const Vec2d&,
                                                       const std::array<Vec2d, 1>&,
                                                       TerrainCells&) const;

}  // namespace tessera::render
