#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Lookup of a scene's textures: level 0, bilinear as a + f (b - a), which is exact on constants;
/// sRGB codes are decoded before filtering. Refers to the scene, which must outlive it.
class TextureTable {
 public:
  explicit TextureTable(const Scene& scene);

  /// RGBA of `ref` at (u, v), without factors; (0, 0) is the corner of the image's first texel. A
  /// missing texture is white. Non-finite coordinates count as 0.
  Vec4f lookup(const TextureRef& ref, Vec2f uv) const;

  /// Procedural texture of `ref`, or null for an image. Requires a ref with a texture.
  const ProceduralTexture* procedural(const TextureRef& ref) const {
    return views_[static_cast<std::size_t>(ref.texture)].procedural;
  }
  bool has_procedural() const { return has_procedural_; }
  /// Scene::center, which procedural textures in world space add back.
  const Vec3d& center() const { return center_; }

  /// Decoded texel (x, y) of the image of `ref`, after wrapping; used for building tables.
  Vec4f texel(const TextureRef& ref, std::int32_t x, std::int32_t y) const;

  std::int64_t memory_bytes() const;

 private:
  struct View {
    const Image* image = nullptr;
    const ProceduralTexture* procedural = nullptr;
    Wrap wrap_u = Wrap::repeat, wrap_v = Wrap::repeat;
    bool nearest = false;
  };

  Vec4f fetch(const View& view, bool srgb, std::int32_t x, std::int32_t y) const;

  std::vector<View> views_;
  bool has_procedural_ = false;
  Vec3d center_;
  std::array<float, 256> linear8_{}, srgb8_{};
  std::vector<float> srgb16_;  // only if a 16-bit image is read as sRGB
};

/// UV coordinates transformed by KHR_texture_transform: matrix * (u, v, 1).
inline Vec2f transformed_uv(const TextureRef& ref, Vec2f uv) {
  if (!ref.has_transform) return uv;
  const auto& m = ref.uv_matrix;
  return {m[0] * uv.x + m[1] * uv.y + m[2], m[3] * uv.x + m[4] * uv.y + m[5]};
}

}  // namespace tessera::render
