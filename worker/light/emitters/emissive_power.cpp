#include "worker/light/emitters/emissive_power.h"

#include <algorithm>
#include <cmath>

namespace tessera::render {
namespace {

/// Range [first, last] of texels that lookups between two coordinates may touch; the whole image if
/// the interval leaves it or is not finite. Never too small.
struct TexelRange {
  std::int32_t first, last;
};
TexelRange texel_span(float low, float high, std::int32_t size, bool repeats) {
  const TexelRange whole{0, size - 1};
  if (!(std::fabs(low) < 1e6f) || !(std::fabs(high) < 1e6f)) return whole;
  const float shift = repeats ? std::floor(low) : 0.0f;
  // One texel of margin on each side for the filter, and one for rounding.
  const double a = std::floor((static_cast<double>(low) - shift) * size - 0.5) - 1;
  const double b = std::floor((static_cast<double>(high) - shift) * size - 0.5) + 2;
  if (repeats && (a < 0 || b >= size)) return whole;
  return {static_cast<std::int32_t>(clamp(a, 0.0, size - 1.0)),
          static_cast<std::int32_t>(clamp(b, 0.0, size - 1.0))};
}

}  // namespace

EmissiveTextureSums::EmissiveTextureSums(const TextureTable& textures, const TextureRef& ref,
                                         const Scene& scene)
    : ref_(ref) {
  const Texture& texture = scene.textures[static_cast<std::size_t>(ref.texture)];
  if (texture.image == kNone) return;
  const Image& image = scene.images[static_cast<std::size_t>(texture.image)];
  width_ = image.width;
  height_ = image.height;
  repeats_u_ = texture.wrap_u != Wrap::clamp;
  repeats_v_ = texture.wrap_v != Wrap::clamp;
  const auto w = static_cast<std::size_t>(width_) + 1, h = static_cast<std::size_t>(height_) + 1;
  sums_.assign(w * h, 0);
  lit_.assign(w * h, 0);
  for (std::size_t y = 1; y < h; ++y) {
    double row = 0;
    std::uint32_t row_lit = 0;
    for (std::size_t x = 1; x < w; ++x) {
      const Vec4f c =
          textures.texel(ref, static_cast<std::int32_t>(x) - 1, static_cast<std::int32_t>(y) - 1);
      const double brightness = luminance(max(c.xyz(), Vec3f{0, 0, 0}));
      row += brightness;
      row_lit += brightness > 0 ? 1 : 0;
      sums_[y * w + x] = sums_[(y - 1) * w + x] + row;
      lit_[y * w + x] = lit_[(y - 1) * w + x] + row_lit;
    }
  }
}

double EmissiveTextureSums::box(std::int32_t x0, std::int32_t x1, std::int32_t y0,
                                std::int32_t y1) const {
  const auto w = static_cast<std::size_t>(width_) + 1;
  const auto left = static_cast<std::size_t>(x0), right = static_cast<std::size_t>(x1) + 1;
  const auto top = static_cast<std::size_t>(y0) * w,
             bottom = (static_cast<std::size_t>(y1) + 1) * w;
  const std::uint32_t lit =
      lit_[bottom + right] - lit_[top + right] - lit_[bottom + left] + lit_[top + left];
  if (lit == 0) return 0;
  const double sum =
      sums_[bottom + right] - sums_[top + right] - sums_[bottom + left] + sums_[top + left];
  const double count = static_cast<double>(x1 - x0 + 1) * (y1 - y0 + 1);
  // Rounding of large sums may yield 0 for a dim box; one code of 8-bit sRGB is 3e-4.
  return std::max(sum, lit * 1e-6) / count;
}

double EmissiveTextureSums::mean(const Vec2f& a, const Vec2f& b, const Vec2f& c) const {
  if (width_ == 0) return 1;
  const Vec2f p = transformed_uv(ref_, a), q = transformed_uv(ref_, b), r = transformed_uv(ref_, c);
  const TexelRange x =
      texel_span(std::min({p.x, q.x, r.x}), std::max({p.x, q.x, r.x}), width_, repeats_u_);
  const TexelRange y =
      texel_span(std::min({p.y, q.y, r.y}), std::max({p.y, q.y, r.y}), height_, repeats_v_);
  return box(x.first, x.last, y.first, y.last);
}

}  // namespace tessera::render
