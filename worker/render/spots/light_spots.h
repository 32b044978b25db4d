#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/math/vector.h"
#include "worker/render/spots/spot_search.h"
#include "worker/sampling/pixel_filter.h"

namespace tessera::render {

/// Small images of lights in the picture, seen directly or by mirrors and lenses. Few samples of a
/// pixel hit them, so a second sample of each is sent to them. Any spots are correct: they only
/// decide how the samples are distributed. Immutable.
class LightSpots {
 public:
  /// A spot that matters to a pixel.
  struct Share {
    std::uint32_t spot = 0;
    float probability = 0;  // of choosing it
  };

  /// The spots within the filter's support around a pixel.
  class Pixel {
   public:
    bool empty() const { return shares_.empty(); }
    /// A second path of a sample.
    struct Second {
      Vec2f offset;             // of its camera ray from the pixel's centre, pixels
      std::uint64_t lobes = 1;  // that it follows (with_lobe())
      float weight = 0;         // of the light that it finds
    };
    /// For u in [0, 1)^2; `choice` in [0, 1) chooses a spot.
    Second sample(float choice, const Vec2f& u) const;
    /// Weight of light that another path finds by `lobes`.
    float weight(const Vec2f& offset, std::uint64_t lobes) const;

   private:
    friend class LightSpots;
    /// Densities per square pixel of the second path.
    struct Density {
      double sampled = 0;  // with these lobes
      double weighed = 0;  // relative to the probability that other paths have these lobes
    };
    Density density(const Vec2f& offset, std::uint64_t lobes) const;
    double density_of(const LightSpot& spot, const Vec2f& offset) const;
    Vec2f sample_in(const LightSpot& spot, const Vec2f& u) const;

    std::span<const Share> shares_;
    const LightSpots* all_ = nullptr;
    double x_ = 0, y_ = 0;  // centre
  };

  /// `filter` must outlive this.
  LightSpots(std::vector<LightSpot> spots, const PixelFilterSampler& filter, std::int32_t width,
             std::int32_t height);

  Pixel at(std::int32_t x, std::int32_t y) const;
  bool empty() const { return shares_.empty(); }
  std::int64_t memory_bytes() const;

 private:
  /// Returns whether the whole pixel filter is sampled instead of the spot.
  bool is_wide(const LightSpot& spot) const { return spot.area() > filter_.area(); }

  const PixelFilterSampler& filter_;
  std::int32_t width_;
  std::vector<LightSpot> spots_;
  std::vector<std::uint32_t> first_;  // by pixel, row-major: its first share; and the end
  std::vector<Share> shares_;
};

}  // namespace tessera::render
