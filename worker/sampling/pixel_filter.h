#pragma once

#include "contract/render_settings.h"
#include "worker/math/vector.h"
#include "worker/sampling/distribution.h"

namespace tessera::render {

/// Importance sampling of the pixel filter: samples are distributed by the filter, so each has the
/// weight 1 and belongs to one pixel.
///
/// Every filter is the product of two equal one-dimensional filters, positive on their support of
/// `width` pixels: box (constant), gaussian (sigma = width / 6, truncated at 3 sigma) and
/// Blackman-Harris (4 terms). All except the box are tables of 1024 steps over the support.
class PixelFilterSampler {
 public:
  /// Requires width > 0, in pixels.
  PixelFilterSampler(contract::PixelFilter filter, double width);

  /// Offset from the pixel's centre, in pixels, in [-width / 2, width / 2) per axis.
  Vec2f sample(Vec2f u) const;

  /// Density of sample() at an offset, per square pixel; 0 outside the support.
  float density(Vec2f offset) const { return density(offset.x) * density(offset.y); }

  float width() const { return width_; }
  /// Area over which a constant filter as high as this one's centre spreads, square pixels.
  double area() const { return 1 / double{density(Vec2f{0, 0})}; }

 private:
  float invert(float u) const;
  float density(float offset) const;

  float width_;
  DiscreteDistribution steps_;  // empty for the box
};

}  // namespace tessera::render
