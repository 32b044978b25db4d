#include "image/denoise/frames/frame_fusion.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "image/denoise/filter/filter_parameters.h"
#include "image/denoise/frames/parallel.h"

namespace tessera::image {
namespace {

using contract::PixelRect;
using P = FilterParameters;

/// Size of the parts that threads work on.
constexpr std::int32_t kPartWidth = 128, kPartHeight = 64;
constexpr std::int32_t kPatch = 1, kNoiseRadius = 2;
constexpr std::size_t kPlanesPerReplicate = 3 + kHalfFeatures, kDepthPlane = 3 + 6;

std::size_t index_of(std::int32_t x, std::int32_t y, std::int32_t width) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
         static_cast<std::size_t>(x);
}

/// Parts of a rectangle, row by row.
std::vector<PixelRect> parts_of(const PixelRect& all) {
  std::vector<PixelRect> parts;
  for (std::int32_t y = all.y; y < all.y + all.height; y += kPartHeight) {
    for (std::int32_t x = all.x; x < all.x + all.width; x += kPartWidth) {
      parts.push_back({x, y, std::min(kPartWidth, all.x + all.width - x),
                       std::min(kPartHeight, all.y + all.height - y)});
    }
  }
  return parts;
}

/// A pixel of a guide, with its noise. Colours are in units of the mean luminance of the frame to
/// be fused.
struct GuidePixel {
  float r = 0, g = 0, b = 0, noise = 0, tolerance = 0;
};

/// The guide of a half for the pixels of a frame and kPatch pixels around it.
class FusionGuide {
 public:
  /// `scale` is that of the guide's colours.
  FusionGuide(const GuideRows& guide, const DenoiseFrame& frame, float scale, int threads)
      : stride_(frame.width + 2 * kPatch),
        pixels_(index_of(0, frame.height + 2 * kPatch, stride_)) {
    for_all(frame.height + 2 * kPatch, threads, [&](std::int32_t row) {
      for (std::int32_t x = -kPatch; x < frame.width + kPatch; ++x)
        pixels_[index_of(x + kPatch, row, stride_)] = pixel(guide, x, row - kPatch, scale);
    });
  }

  const GuidePixel* at(std::int32_t x, std::int32_t y) const {
    return &pixels_[index_of(x + kPatch, y + kPatch, stride_)];
  }
  std::int32_t stride() const { return stride_; }

 private:
  static GuidePixel pixel(const GuideRows& guide, std::int32_t x, std::int32_t y, float scale) {
    constexpr float kShare = 1.0f / ((2 * kNoiseRadius + 1) * (2 * kNoiseRadius + 1));
    float noise = 0;
    for (std::int32_t dy = -kNoiseRadius; dy <= kNoiseRadius; ++dy) {
      const float* row = guide.row(3, y + dy);
      for (std::int32_t dx = -kNoiseRadius; dx <= kNoiseRadius; ++dx) noise += row[x + dx];
    }
    GuidePixel at;
    at.r = guide.row(0, y)[x] * scale;
    at.g = guide.row(1, y)[x] * scale;
    at.b = guide.row(2, y)[x] * scale;
    at.noise = noise * kShare * (scale * scale);
    at.tolerance = (P::kFusionNoise * at.noise +
                    P::kFusionTolerance * ((at.r * at.r + at.g * at.g) + at.b * at.b)) +
                   P::kMinSquare;
    return at;
  }

  std::int32_t stride_;
  std::vector<GuidePixel> pixels_;
};

/// Mean over the patches of the squared differences beyond what noise explains, relative to the
/// tolerance. NaN if the guides overflow.
float patch_distance(const GuidePixel* p, std::int32_t p_stride, const GuidePixel* q,
                     std::int32_t q_stride) {
  float sum = 0;
  for (std::ptrdiff_t dy = -kPatch; dy <= kPatch; ++dy) {
    for (std::ptrdiff_t dx = -kPatch; dx <= kPatch; ++dx) {
      const GuidePixel &a = p[dy * p_stride + dx], &b = q[dy * q_stride + dx];
      const float red = a.r - b.r, green = a.g - b.g, blue = a.b - b.b;
      const float noise = a.noise + std::min(a.noise, b.noise);
      sum += (((red * red + green * green) + blue * blue) - noise) / (a.tolerance + b.tolerance);
    }
  }
  const float mean = sum * (1.0f / 9);
  return mean < 0 ? 0 : mean;
}

/// Fuses one half of a frame.
class HalfFusion {
 public:
  HalfFusion(const AnimationFrame& frame, const AnimationFrame* before, const AnimationFrame* after,
             std::size_t half, int threads)
      : frame_(frame),
        half_(half),
        width_(frame.frame.width),
        height_(frame.frame.height),
        guide_(frame.guides[half], frame.frame, 1, threads) {
    const AnimationFrame* others[] = {before, after};
    for (std::size_t k = 0; k < 2; ++k) {
      if (others[k] == nullptr) continue;
      const auto scale =
          static_cast<float>(others[k]->frame.mean_luminance / frame.frame.mean_luminance);
      others_.push_back({*others[k], k,
                         FusionGuide(others[k]->guides[half], others[k]->frame, scale, threads),
                         scale});
    }
  }

  /// Fuses the pixels of a part of the frame.
  void fuse(const PixelRect& part, FusedFrame& to) const {
    const FrameInput input(frame_.frame, frame_.rows);
    const Half half = input.half(half_, part);
    for (std::int32_t row = 0; row < part.height; ++row) {
      std::size_t i = half.inside(row);
      for (std::int32_t column = 0; column < part.width; ++column, ++i)
        fuse_pixel(half, i, part.x + column, part.y + row, to);
    }
  }

 private:
  /// The previous or the next frame.
  struct Other {
    const AnimationFrame& frame;
    std::size_t direction;  // 0: previous, 1: next
    FusionGuide guide;
    float scale;  // of its guide's colours
  };
  /// A pixel of another frame that counts.
  struct Tap {
    const Other* other;
    std::int32_t x, y;
    float weight;
  };
  static constexpr std::size_t kMaxTaps = 8;
  struct Taps {
    std::array<Tap, kMaxTaps> taps;
    std::size_t count = 0;
    float total = 1;  // of all weights, with that of the pixel itself
  };

  void fuse_pixel(const Half& half, std::size_t i, std::int32_t x, std::int32_t y,
                  FusedFrame& to) const {
    Taps taps;
    for (const Other& other : others_) find_taps(half, i, x, y, other, taps);
    const std::size_t at = index_of(x, y, width_);
    for (std::size_t k = 0; k < 2 * kPlanesPerReplicate; ++k) {
      const std::size_t plane = 2 * half_ * kPlanesPerReplicate + k;
      const float own = frame_.rows.planes[plane][at];
      to.planes[plane][at] = own;
      if (taps.count == 0 || k % kPlanesPerReplicate == kDepthPlane) continue;
      const float share = 1 / taps.total;
      float sum = own * share;
      for (std::size_t t = 0; t < taps.count; ++t) {
        const Tap& tap = taps.taps[t];
        sum += tap.other->frame.rows.planes[plane][index_of(tap.x, tap.y, width_)] *
               (tap.weight * share);
      }
      to.planes[plane][at] = sum;
    }
    if (taps.count > 0) fuse_guide(taps, x, y, to.guides[half_]);
  }

  /// The mean of the guides. Their errors are taken to be independent.
  void fuse_guide(const Taps& taps, std::int32_t x, std::int32_t y, GuideRows& guide) const {
    const float share = 1 / taps.total;
    for (std::size_t c = 0; c < 3; ++c) {
      float& value = guide.row(c, y)[x];
      value *= share;
      for (std::size_t t = 0; t < taps.count; ++t) {
        const Tap& tap = taps.taps[t];
        value += tap.other->frame.guides[half_].row(c, tap.y)[tap.x] *
                 (tap.weight * share * tap.other->scale);
      }
    }
    float& variance = guide.row(3, y)[x];
    variance *= share * share;
    for (std::size_t t = 0; t < taps.count; ++t) {
      const Tap& tap = taps.taps[t];
      const float factor = tap.weight * share * tap.other->scale;
      variance += tap.other->frame.guides[half_].row(3, tap.y)[tap.x] * (factor * factor);
    }
  }

  /// Finds the pixels of another frame around the place to which the surface moves.
  void find_taps(const Half& half, std::size_t i, std::int32_t x, std::int32_t y,
                 const Other& other, Taps& taps) const {
    const std::size_t at = index_of(x, y, width_);
    const float dx = frame_.motion[2 * other.direction][at],
                dy = -frame_.motion[2 * other.direction + 1][at];
    const float to_x = static_cast<float>(x) + dx, to_y = static_cast<float>(y) + dy;
    if (!(to_x > -1 && to_y > -1 && to_x < static_cast<float>(width_) &&
          to_y < static_cast<float>(height_)))
      return;
    const float left = std::floor(to_x), top = std::floor(to_y);
    const float across = to_x - left, down = to_y - top;
    for (std::int32_t k = 0; k < 4; ++k) {
      const std::int32_t right = k % 2, lower = k / 2;
      const float share = (right != 0 ? across : 1 - across) * (lower != 0 ? down : 1 - down);
      const Tap tap{&other, static_cast<std::int32_t>(left) + right,
                    static_cast<std::int32_t>(top) + lower, share};
      if (!(share > P::kMinTapShare) || tap.x < 0 || tap.y < 0 || tap.x >= width_ ||
          tap.y >= height_ || !leads_back(tap, x, y))
        continue;
      const float weight = share * similarity(half, i, x, y, tap);
      if (!(weight > 0)) continue;
      taps.taps[taps.count] = tap;
      taps.taps[taps.count++].weight = weight;
      taps.total += weight;
    }
  }

  /// Whether the motion of the other frame's pixel leads to the pixel (x, y).
  bool leads_back(const Tap& tap, std::int32_t x, std::int32_t y) const {
    const std::size_t at = index_of(tap.x, tap.y, width_), back = 2 * (1 - tap.other->direction);
    const float dx = tap.other->frame.motion[back][at], dy = -tap.other->frame.motion[back + 1][at];
    const float off_x = static_cast<float>(tap.x - x) + dx,
                off_y = static_cast<float>(tap.y - y) + dy;
    const float limit = P::kMotionTolerance + P::kMotionSpread * (std::fabs(dx) + std::fabs(dy));
    return std::fabs(off_x) < limit && std::fabs(off_y) < limit;
  }

  /// Weight of a tap by colour, albedo and normal; NaN counts as 0.
  float similarity(const Half& half, std::size_t i, std::int32_t x, std::int32_t y,
                   const Tap& tap) const {
    const FusionGuide& guide = tap.other->guide;
    float distance =
        patch_distance(guide_.at(x, y), guide_.stride(), guide.at(tap.x, tap.y), guide.stride());
    if (!(distance < 8)) return 0;
    const std::size_t at = index_of(tap.x, tap.y, width_),
                      first = 2 * half_ * kPlanesPerReplicate + 3;
    float albedo = 0, normal = 0;
    for (std::size_t k = 0; k < kHalfFeatures; ++k) {
      if (k == 6) continue;  // the depth of a moving surface changes
      const auto& planes = tap.other->frame.rows.planes;
      const float value =
          0.5f * (planes[first + k][at] + planes[first + kPlanesPerReplicate + k][at]);
      const float difference = half.features[k][i] - value;
      (k >= 3 && k < 6 ? normal : albedo) += difference * difference;
    }
    distance += albedo * half.albedo_weight[i] + normal * half.normal_weight[i];
    return filter_weight(distance);
  }

  const AnimationFrame& frame_;
  const std::size_t half_;
  const std::int32_t width_, height_;
  const FusionGuide guide_;
  std::vector<Other> others_;
};

}  // namespace

void find_guides(AnimationFrame& frame, int threads) {
  const FrameInput input(frame.frame, frame.rows);
  const std::int32_t width = frame.frame.width, height = frame.frame.height;
  const PixelRect all{-kGuideBeyond, -kGuideBeyond, width + 2 * kGuideBeyond,
                      height + 2 * kGuideBeyond};
  for (GuideRows& guide : frame.guides) {
    guide = GuideRows(all.x, all.y, all.width);
    guide.extend(all.y + all.height);
  }
  const std::vector<PixelRect> parts = parts_of(all);
  for_all(2 * static_cast<std::int32_t>(parts.size()), threads, [&](std::int32_t i) {
    const auto half = static_cast<std::size_t>(i % 2);
    frame.guides[half].add(input, half, parts[static_cast<std::size_t>(i / 2)]);
  });
}

DenoiseRows FusedFrame::rows() const {
  DenoiseRows rows;
  for (std::size_t k = 0; k < planes.size(); ++k) rows.planes[k] = planes[k].data();
  return rows;
}

FusedFrame fuse_frames(const AnimationFrame& frame, const AnimationFrame* before,
                       const AnimationFrame* after, int threads) {
  FusedFrame fused;
  fused.guides = frame.guides;
  const std::int32_t width = frame.frame.width, height = frame.frame.height;
  for (std::vector<float>& plane : fused.planes) plane.resize(index_of(0, height, width));
  const std::vector<PixelRect> parts = parts_of({0, 0, width, height});
  for (std::size_t half = 0; half < 2; ++half) {
    const HalfFusion fusion(frame, before, after, half, threads);
    for_all(static_cast<std::int32_t>(parts.size()), threads,
            [&](std::int32_t i) { fusion.fuse(parts[static_cast<std::size_t>(i)], fused); });
  }
  return fused;
}

}  // namespace tessera::image
