#include "worker/shading/texture/texture.h"

#include <cmath>

#include "worker/shading/texture/srgb.h"

namespace tessera::render {
namespace {

/// Reduces a coordinate to the period of its wrap mode, so that texel indices stay small: [0, 1]
/// for repeat and clamp, [0, 2] for mirror.
float into_period(float u, Wrap wrap) {
  float folded = 0;
  switch (wrap) {
    case Wrap::repeat:
      folded = u - std::floor(u);
      break;
    case Wrap::mirror:
      folded = u - 2 * std::floor(u / 2);
      break;
    case Wrap::clamp:
      folded = clamp(u, 0.0f, 1.0f);
      break;
  }
  return folded >= 0 && folded <= 2 ? folded : 0.0f;  // NaN and infinities become 0
}

/// Texel index in [0, size) for an index at most one period outside. Requires size >= 1.
std::int32_t wrapped(std::int32_t i, std::int32_t size, Wrap wrap) {
  switch (wrap) {
    case Wrap::repeat:
      return i < 0 ? i + size : i >= size ? i - size : i;
    case Wrap::mirror:
      if (i < 0) i = -1 - i;
      if (i >= size) i = 2 * size - 1 - i;
      return i < 0 ? -1 - i : i;
    case Wrap::clamp:
      break;
  }
  return clamp(i, std::int32_t{0}, size - 1);
}

/// RGBA of a texel with 1 to 4 channels: grey is replicated; alpha is the last of 2 or 4 channels,
/// otherwise 1.
template <typename Code, typename Color, typename Alpha>
Vec4f spread(const Code* codes, std::int32_t channels, const Color& color, const Alpha& alpha) {
  const float first = color(codes[0]);
  if (channels >= 3) {
    return {first, color(codes[1]), color(codes[2]), channels == 4 ? alpha(codes[3]) : 1.0f};
  }
  return {first, first, first, channels == 2 ? alpha(codes[1]) : 1.0f};
}

}  // namespace

TextureTable::TextureTable(const Scene& scene) : center_(scene.center), srgb8_(srgb8_table()) {
  for (std::size_t i = 0; i < linear8_.size(); ++i) linear8_[i] = static_cast<float>(i) / 255;
  bool needs_srgb16 = false;
  for (const Texture& texture : scene.textures) {
    View view;
    if (texture.image != kNone) view.image = &scene.images[static_cast<std::size_t>(texture.image)];
    if (texture.procedural != kNone) {
      view.procedural = &scene.procedural_textures[static_cast<std::size_t>(texture.procedural)];
      has_procedural_ = true;
    }
    view.wrap_u = texture.wrap_u;
    view.wrap_v = texture.wrap_v;
    view.nearest = texture.nearest;
    views_.push_back(view);
    needs_srgb16 |= view.image != nullptr && view.image->storage == Image::Storage::u16;
  }
  if (needs_srgb16) srgb16_ = srgb16_table();
}

Vec4f TextureTable::fetch(const View& view, bool srgb, std::int32_t x, std::int32_t y) const {
  const Image& image = *view.image;
  const std::int32_t channels = image.channels;
  const std::size_t at = (static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                          static_cast<std::size_t>(x)) *
                         static_cast<std::size_t>(channels);
  switch (image.storage) {
    case Image::Storage::u8: {
      const auto& color = srgb ? srgb8_ : linear8_;
      return spread(
          &image.u8[at], channels, [&](std::uint8_t c) { return color[c]; },
          [&](std::uint8_t a) { return linear8_[a]; });
    }
    case Image::Storage::u16: {
      const auto linear = [](std::uint16_t c) { return static_cast<float>(c) / 65535; };
      if (!srgb) return spread(&image.u16[at], channels, linear, linear);
      return spread(
          &image.u16[at], channels, [&](std::uint16_t c) { return srgb16_[c]; }, linear);
    }
    case Image::Storage::f32:
      break;
  }
  const auto same = [](float c) { return c; };
  return spread(&image.f32[at], channels, same, same);
}

Vec4f TextureTable::texel(const TextureRef& ref, std::int32_t x, std::int32_t y) const {
  const View& view = views_[static_cast<std::size_t>(ref.texture)];
  if (view.image == nullptr) return {1, 1, 1, 1};
  return fetch(view, ref.srgb, wrapped(x, view.image->width, view.wrap_u),
               wrapped(y, view.image->height, view.wrap_v));
}

Vec4f TextureTable::lookup(const TextureRef& ref, Vec2f uv) const {
  if (!ref) return {1, 1, 1, 1};
  const View& view = views_[static_cast<std::size_t>(ref.texture)];
  if (view.image == nullptr) return {1, 1, 1, 1};
  const std::int32_t width = view.image->width, height = view.image->height;
  const Vec2f p = transformed_uv(ref, uv);
  const float u = into_period(p.x, view.wrap_u) * static_cast<float>(width);
  const float v = into_period(p.y, view.wrap_v) * static_cast<float>(height);
  if (view.nearest) {
    return fetch(view, ref.srgb, wrapped(static_cast<std::int32_t>(u), width, view.wrap_u),
                 wrapped(static_cast<std::int32_t>(v), height, view.wrap_v));
  }
  const float x = u - 0.5f, y = v - 0.5f;
  const float left = std::floor(x), top = std::floor(y);
  const auto i = static_cast<std::int32_t>(left), j = static_cast<std::int32_t>(top);
  const std::int32_t x0 = wrapped(i, width, view.wrap_u), x1 = wrapped(i + 1, width, view.wrap_u);
  const std::int32_t y0 = wrapped(j, height, view.wrap_v), y1 = wrapped(j + 1, height, view.wrap_v);
  const Vec4f a = fetch(view, ref.srgb, x0, y0), b = fetch(view, ref.srgb, x1, y0);
  const Vec4f c = fetch(view, ref.srgb, x0, y1), d = fetch(view, ref.srgb, x1, y1);
  const float fx = x - left, fy = y - top;
  const Vec4f upper = a + (b - a) * fx, lower = c + (d - c) * fx;
  return upper + (lower - upper) * fy;
}

std::int64_t TextureTable::memory_bytes() const {
  return static_cast<std::int64_t>(srgb16_.size() * sizeof(float) + views_.size() * sizeof(View));
}

}  // namespace tessera::render
