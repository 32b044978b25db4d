#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "worker/geometry/shapes/terrain/affine_form.h"
#include "worker/math/vector.h"
#include "worker/sampling/gradient_noise.h"

namespace tessera::render {

using Vec2d = Vec2<double>;

/// Parameters of a height field over the rectangle size.x by size.y centred at the origin: `height`
/// times a pattern of x and z with values in [0, 1]. The patterns fbm and ridged are those of
/// TESSERA_texture.
struct TerrainForm {
  enum class Pattern : std::uint8_t {
    fbm,     // the sum of octaves of gradient noise
    ridged,  // Musgrave's multifractal: crests where noise crosses zero
    waves,   // the sum of octaves of sin(2 pi x) cos(2 pi z)
  };
  Pattern pattern = Pattern::ridged;
  Vec2d size = {1, 1};
  double height = 1;
  double scale = 1;          // features per metre
  Vec2d offset;              // in features
  std::int32_t octaves = 8;  // 0: a plane
  double lacunarity = 2, gain = 0.5;
  std::uint32_t seed = 0;

  /// Angular size, radians, of the smallest resolved detail as seen from `seen_from`; 0: all
  /// detail. Octaves with more than one feature per footprint of this size are replaced by their
  /// mean, those with less than half a feature are complete. Depends on the position, not on the
  /// ray, so that all rays meet the same surface.
  double spot_angle = 0;
  Vec3d seen_from;
};

inline constexpr std::int32_t kMaxTerrainOctaves = 24;

/// The most recent noise cell of each octave: successive points of a line share most of them.
using TerrainCells = std::array<NoiseCell, kMaxTerrainOctaves>;

/// Heights of a terrain and their bounds. Immutable; callers own the caches.
class TerrainField {
 public:
  explicit TerrainField(const TerrainForm& form);

  const TerrainForm& form() const { return form_; }

  /// Bounds of the height over at + sum of spans[k] s[k], s[k] in [-1, 1], rounding included.
  /// Requires orthogonal spans.
  template <std::size_t N>
  AffineForm<N> heights(const Vec2d& at, const std::array<Vec2d, N>& spans,
                        TerrainCells& cells) const;

  /// Bounds of y minus the height over the same region. Evaluates octaves only until the sign is
  /// known.
  template <std::size_t N>
  AffineForm<N> clearance(const AffineForm<N>& y, const Vec2d& at,
                          const std::array<Vec2d, N>& spans, TerrainCells& cells) const;

  double height(const Vec2d& at) const;
  /// Derivatives of the height by x and z; on a crest, between those of both sides.
  Vec2d slope(const Vec2d& at) const;

  /// Length, metres, below which a line may miss ground that it passes through: half of the
  /// smallest resolved detail, or a 1024th of the finest feature if that is larger.
  double precision(const Vec2d& at) const;
  /// Bound of the rounding error of heights.
  double rounding() const { return rounding_; }

  struct Range {
    float low, high;
  };
  /// Number of levels of a quadtree of heights: level l has 2^l by 2^l cells.
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
  double amplitudes_ = 0;            // sum of the octaves' amplitudes
  double to_height_ = 0, base_ = 0;  // height = sum of octaves * to_height_ + base_
  double finest_ = 1;                // size of the last octave's features, or of the terrain
  double rounding_ = 0;
  std::vector<std::vector<Range>> levels_;  // coarsest first
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
