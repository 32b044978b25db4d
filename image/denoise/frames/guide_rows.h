#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "contract/render_settings.h"
#include "image/denoise/filter/half_filter.h"
#include "image/denoise/filter/rolling_rows.h"
#include "image/denoise/frames/frame_input.h"

namespace tessera::image {

/// Pixels beyond the frame for which the guide is needed: windows end at the frame; patches and
/// noise reach 1 + 2 pixels further than blended pixels do.
constexpr std::int32_t kGuideBeyond = 5;

/// The guide of a half of a frame, in rows that begin at x = left().
class GuideRows {
 public:
  GuideRows() = default;
  /// Rows of `width` pixels from (left, top) on.
  GuideRows(std::int32_t left, std::int32_t top, std::int32_t width)
      : left_(left), planes_(kPlanes, RollingRows<float>(width, top)) {}

  void extend(std::int32_t end);
  void drop(std::int32_t begin);
  /// Filters the pixels of `part`, of half 0 or 1.
  void add(const FrameInput& input, std::size_t half, const contract::PixelRect& part);
  /// The guide of `part`; 0 where it is not known.
  Guide cut(const contract::PixelRect& part) const;

  std::int32_t left() const { return left_; }
  /// R, G, B, and the variance summed over the channels.
  static constexpr std::size_t kPlanes = 4;
  float* row(std::size_t plane, std::int32_t y) { return planes_[plane].row(y) - left_; }
  const float* row(std::size_t plane, std::int32_t y) const {
    return planes_[plane].row(y) - left_;
  }

 private:
  std::int32_t left_ = 0;
  std::vector<RollingRows<float>> planes_;
};

/// Copies a part of rows that begin at x = `left`; pixels that they do not have are 0.
Plane cut_rows(const RollingRows<float>& from, std::int32_t left, const contract::PixelRect& part);

}  // namespace tessera::image
