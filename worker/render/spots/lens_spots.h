#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/math/vector.h"
#include "worker/render/camera/aperture.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/render/spots/searched_lights.h"
#include "worker/render/spots/specular_segments.h"
#include "worker/sampling/pixel_filter.h"

namespace tessera::render {

/// A light that the camera sees out of focus: the box around it on the camera's axes.
struct LensSpot {
  Vec3d low, high;       // right, up and forward of the lens's centre, metres
  float brightness = 0;  // luminance
};

/// Finds the lights that are visible from some point of the lens and are in front of the plane of
/// focus or behind it. Requires a camera with a lens that does not move.
std::vector<LensSpot> find_lens_spots(const CameraRays& camera, SpecularTracer tracer,
                                      std::span<const SearchedLight> lights);

/// Lights that appear as discs because they are out of focus. A ray from a point of the film meets
/// such a light only if it passes through a small part of the lens. Each sample has a second path
/// through this part, for a light that is chosen among those around its pixel. Any spots are
/// correct: they only decide how the samples are distributed. Immutable.
class LensSpots {
 public:
  /// A light that matters to a block of pixels.
  struct Share {
    std::uint32_t spot = 0;
    float probability = 0;  // of choosing it
  };

  /// The lights around a pixel. `slope` is the film point of a sample (CameraRays::slope_at()).
  class Pixel {
   public:
    bool empty() const { return shares_.empty(); }
    /// A second path of a sample.
    struct Second {
      AperturePoint point;
      float weight = 0;  // of the light that it finds directly
    };
    /// For u in [0, 1)^2; `choice` in [0, 1) chooses a light.
    Second sample(float choice, const Vec2f& u, const Vec2d& slope) const;
    /// Weight of the light that a path through this point of the lens, uniform in the aperture,
    /// finds directly.
    float weight(const AperturePoint& point, const Vec2d& slope) const;

   private:
    friend class LensSpots;
    std::span<const Share> shares_;
    const LensSpots* all_ = nullptr;
  };

  /// `camera` must outlive this.
  LensSpots(std::vector<LensSpot> spots, const CameraRays& camera, const PixelFilterSampler& filter,
            std::int32_t width, std::int32_t height);

  Pixel at(std::int32_t x, std::int32_t y) const;
  bool empty() const { return shares_.empty(); }
  std::int64_t memory_bytes() const;

 private:
  struct Interval {
    double low = 0, high = 0;

    double length() const { return high > low ? high - low : 0; }
    bool contains(double value) const { return low <= value && value <= high; }
    double at(double part) const { return low + part * (high - low); }
    Interval cut(double limit) const {
      return {low > -limit ? low : -limit, high < limit ? high : limit};
    }
  };
  struct Rectangle;
  Interval seen_through(const LensSpot& spot, int axis, double first, double last) const;
  Rectangle seen_through(const LensSpot& spot, const Vec2d& slope) const;
  double density(std::span<const Share> shares, const AperturePoint& point,
                 const Vec2d& slope) const;
  void add_block(const std::vector<std::uint32_t>& in_row, const Vec2d& first, const Vec2d& last);

  const CameraRays& camera_;
  std::vector<LensSpot> spots_;
  std::int32_t columns_;              // of blocks
  std::vector<std::uint32_t> first_;  // by block, row by row: its first share; and the end
  std::vector<Share> shares_;
};

}  // namespace tessera::render
