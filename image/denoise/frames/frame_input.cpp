#include "image/denoise/frames/frame_input.h"

#include <algorithm>
#include <array>

#include "image/denoise/filter/spike_limit.h"

namespace tessera::image {
namespace {

constexpr std::size_t kStreamPlanes = 3 + kHalfFeatures;
static_assert(4 * kStreamPlanes == kDenoiseInputs);

/// A colour beyond this, in units of the mean luminance, would overflow when it is squared.
constexpr float kLargestColour = 1e15f;

float limited(float value) {  // GCC does not make vectors of std::clamp
  const float least = value < -kLargestColour ? -kLargestColour : value;
  return kLargestColour < least ? kLargestColour : least;
}

std::size_t pixel_count(const contract::PixelRect& part) {
  return static_cast<std::size_t>(part.width) * static_cast<std::size_t>(part.height);
}

/// The values of `part` from a plane that has kSpikeMargin more on each side.
Plane without_margin(const Plane& plane, const contract::PixelRect& part) {
  Plane inner;
  inner.reserve(pixel_count(part));
  const std::ptrdiff_t stride = part.width + 2 * kSpikeMargin;
  for (std::ptrdiff_t row = 0; row < part.height; ++row) {
    const auto from = plane.begin() + (row + kSpikeMargin) * stride + kSpikeMargin;
    inner.insert(inner.end(), from, from + part.width);
  }
  return inner;
}

}  // namespace

void FrameInput::cut(std::size_t plane, const contract::PixelRect& part, float scale,
                     Plane& out) const {
  out.resize(pixel_count(part));
  // Columns of the part that are in the frame.
  const std::int32_t begin = std::clamp(-part.x, 0, part.width);
  const std::int32_t end = std::clamp(frame_.width - part.x, begin, part.width);
  float* to = out.data();
  for (std::int32_t row = 0; row < part.height; ++row, to += part.width) {
    const std::int32_t y = std::clamp(part.y + row, 0, frame_.height - 1);
    const float* from = rows_.planes[plane] +
                        std::ptrdiff_t{y - rows_.first} * static_cast<std::ptrdiff_t>(frame_.width);
    std::fill(to, to + begin, limited(from[0] * scale));
    const float* inside = from + part.x;
    for (std::int32_t x = begin; x < end; ++x) to[x] = limited(inside[x] * scale);
    std::fill(to + end, to + part.width, limited(from[frame_.width - 1] * scale));
  }
}

StreamPair FrameInput::streams(std::size_t half, const contract::PixelRect& part) const {
  const auto scale = static_cast<float>(1 / frame_.mean_luminance);
  StreamPair streams;
  for (std::size_t c = 0; c < 3; ++c) {
    cut(2 * half * kStreamPlanes + c, part, scale, streams.a[c]);
    cut((2 * half + 1) * kStreamPlanes + c, part, scale, streams.b[c]);
  }
  return streams;
}

Half FrameInput::half(std::size_t index, const contract::PixelRect& part) const {
  const contract::PixelRect bordered{part.x - kHalfMargin, part.y - kHalfMargin,
                                     (part.width + 7) / 8 * 8 + 2 * kHalfMargin,
                                     part.height + 2 * kHalfMargin};
  Half half;
  half.width = bordered.width;
  half.height = bordered.height;
  half.valid = valid(bordered);
  half.streams = limited_streams(index, bordered);
  std::array<Plane, kHalfFeatures> features[2];
  for (std::size_t s = 0; s < 2; ++s) {
    for (std::size_t k = 0; k < kHalfFeatures; ++k)
      cut((2 * index + s) * kStreamPlanes + 3 + k, bordered, 1, features[s][k]);
  }
  prepare(features[0], features[1], half);
  return half;
}

Plane FrameInput::valid(const contract::PixelRect& part) const {
  Plane valid;
  valid.reserve(pixel_count(part));
  for (std::int32_t y = part.y; y < part.y + part.height; ++y) {
    for (std::int32_t x = part.x; x < part.x + part.width; ++x) {
      const bool inside = x >= 0 && y >= 0 && x < frame_.width && y < frame_.height;
      valid.push_back(inside ? 1.0f : 0.0f);
    }
  }
  return valid;
}

StreamPair FrameInput::limited_streams(std::size_t half, const contract::PixelRect& part) const {
  const contract::PixelRect enlarged{part.x - kSpikeMargin, part.y - kSpikeMargin,
                                     part.width + 2 * kSpikeMargin, part.height + 2 * kSpikeMargin};
  StreamPair streams = this->streams(half, enlarged);
  limit_spikes(valid(enlarged), enlarged.width, streams);
  for (ColourPlanes* colour : {&streams.a, &streams.b}) {
    for (Plane& plane : *colour) plane = without_margin(plane, part);
  }
  return streams;
}

}  // namespace tessera::image
