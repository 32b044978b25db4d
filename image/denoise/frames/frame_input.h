#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "contract/render_settings.h"
#include "image/denoise/filter/half_filter.h"

namespace tessera::image {

/// Planes that denoising reads: for each of four replicates the channels of layers.h, in order.
constexpr int kDenoiseInputs = 44;

/// A frame of which some pixels are denoised.
struct DenoiseFrame {
  std::int32_t width = 0, height = 0;
  /// The frame's mean luminance m > 0, the unit of the filter's tolerances.
  double mean_luminance = 1;
};

/// Rows of a frame, row by row from the top, from row `first` on. All values must be finite.
struct DenoiseRows {
  std::int32_t first = 0;
  std::array<const float*, kDenoiseInputs> planes{};
};

/// Cuts the rows of a frame that a Denoiser reads. Pixels beyond the frame repeat its border.
class FrameInput {
 public:
  FrameInput(const DenoiseFrame& frame, const DenoiseRows& rows) : frame_(frame), rows_(rows) {}

  /// The colours of half 0 or 1, in units of the mean luminance.
  StreamPair streams(std::size_t half, const contract::PixelRect& part) const;
  /// Half 0 or 1 without spikes, with `part` inside its border. The width is rounded up.
  Half half(std::size_t index, const contract::PixelRect& part) const;

 private:
  /// streams() without spikes.
  StreamPair limited_streams(std::size_t half, const contract::PixelRect& part) const;
  /// 1 for pixels of the frame, 0 for others.
  Plane valid(const contract::PixelRect& part) const;
  void cut(std::size_t plane, const contract::PixelRect& part, float scale, Plane& out) const;

  const DenoiseFrame& frame_;
  const DenoiseRows& rows_;
};

}  // namespace tessera::image
