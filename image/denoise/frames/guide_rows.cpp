#include "image/denoise/frames/guide_rows.h"

#include <algorithm>

namespace tessera::image {

void GuideRows::extend(std::int32_t end) {
  for (RollingRows<float>& rows : planes_) rows.extend(end);
}

void GuideRows::drop(std::int32_t begin) {
  for (RollingRows<float>& rows : planes_) rows.drop(begin);
}

void GuideRows::add(const FrameInput& input, std::size_t half_index,
                    const contract::PixelRect& part) {
  const Half half = input.half(half_index, part);
  const Guide guide = filter_guide(half);
  for (std::int32_t row = 0; row < part.height; ++row) {
    const std::size_t from = half.inside(row);
    for (std::size_t k = 0; k < kPlanes; ++k) {
      const Plane& plane = k < 3 ? guide.colour[k] : guide.variance;
      std::copy_n(plane.data() + from, part.width, planes_[k].row(part.y + row) + (part.x - left_));
    }
  }
}

Guide GuideRows::cut(const contract::PixelRect& part) const {
  Guide guide;
  for (std::size_t c = 0; c < 3; ++c) guide.colour[c] = cut_rows(planes_[c], left_, part);
  guide.variance = cut_rows(planes_[3], left_, part);
  return guide;
}

Plane cut_rows(const RollingRows<float>& from, std::int32_t left, const contract::PixelRect& part) {
  Plane out(static_cast<std::size_t>(part.width) * static_cast<std::size_t>(part.height));
  const std::int32_t begin = std::clamp(left - part.x, 0, part.width);
  const std::int32_t end = std::clamp(left + from.width() - part.x, begin, part.width);
  float* to = out.data();
  for (std::int32_t y = part.y; y < part.y + part.height; ++y, to += part.width) {
    if (y < from.begin() || y >= from.end()) continue;
    const float* row = from.row(y) + (part.x - left);
    std::copy(row + begin, row + end, to + begin);
  }
  return out;
}

}  // namespace tessera::image
