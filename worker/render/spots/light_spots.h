#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/math/vector.h"
#include "worker/render/spots/convex_polygon.h"
#include "worker/render/spots/spot_search.h"
#include "worker/sampling/pixel_filter.h"

namespace tessera::render {

/// Images of lights in the picture, seen directly or by mirrors and lenses. Where few samples of a
/// pixel hit one, because it is small or only its edge is in the pixel, each sample has a second
/// path towards one of these images. Any spots are correct: they only decide how the samples are
/// distributed. Immutable.
class LightSpots {
 public:
  /// The part of a spot that is in the support of a pixel's filter, if it matters to the pixel.
  struct Share {
    std::uint32_t spot = 0;
    float probability = 0;               // of choosing it
    std::uint32_t first = 0, count = 0;  // of its outline, in outlines_; none: all of the filter
    Vec2d centre;                        // of the outline, from the pixel's centre, pixels
    double area = 0;                     // square pixels
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
    AroundPolygon around(const Share& share) const;

    std::span<const Share> shares_;
    const LightSpots* all_ = nullptr;
  };

  /// `filter` must outlive this.
  LightSpots(std::vector<LightSpot> spots, const PixelFilterSampler& filter, std::int32_t width,
             std::int32_t height);

  Pixel at(std::int32_t x, std::int32_t y) const;
  bool empty() const { return shares_.empty(); }
  std::int64_t memory_bytes() const;

 private:
  /// A share before those of its pixel are chosen.
  struct Candidate {
    std::size_t pixel = 0;
    Share share;
    double weight = 0;
  };
  void add_candidates(std::uint32_t spot, std::int32_t height, std::vector<Candidate>* found);
  void add_candidate(std::uint32_t spot, std::int32_t x, std::int32_t y,
                     std::vector<Candidate>* found);

  const PixelFilterSampler& filter_;
  std::int32_t width_;
  std::vector<LightSpot> spots_;
  std::vector<std::uint32_t> first_;  // by pixel, row-major: its first share; and the end
  std::vector<Share> shares_;
  std::vector<Vec2d> outlines_;  // from the pixel's centre, pixels
};

}  // namespace tessera::render
