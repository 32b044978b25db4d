#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// Mean brightness of an emissive texture over UV boxes in constant time, for choosing triangles by
/// power. Uses summed-area tables, in double and of counts: the mean is zero only if every texel
/// that a bilinear lookup in the box can touch is black.
class EmissiveTextureSums {
 public:
  /// Requires a ref with a texture.
  EmissiveTextureSums(const TextureTable& textures, const TextureRef& ref, const Scene& scene);

  /// Mean luminance of the texels in the bounding box of three UV points (before the transform).
  double mean(const Vec2f& a, const Vec2f& b, const Vec2f& c) const;

 private:
  double box(std::int32_t x0, std::int32_t x1, std::int32_t y0, std::int32_t y1) const;

  TextureRef ref_;
  std::int32_t width_ = 0, height_ = 0;
  bool repeats_u_ = true, repeats_v_ = true;
  std::vector<double> sums_;        // (width + 1) x (height + 1)
  std::vector<std::uint32_t> lit_;  // number of texels that are not black
};

/// Mean radiance of triangles on their front side, by material and texture. Texture sums are built
/// once per material.
class EmittedRadiance {
 public:
  EmittedRadiance(const Scene& scene, const TextureTable& textures)
      : scene_(scene), textures_(textures), sums_(scene.materials.size()) {}

  double at(const Primitive& p, const std::array<std::uint32_t, 3>& t) {
    const auto index = static_cast<std::size_t>(p.material);
    const Material& material = scene_.materials[index];
    const double full = luminance(material.emission);
    const TextureRef& ref = material.emissive_texture;
    if (!ref) return full;
    if (!sums_[index]) sums_[index] = std::make_unique<EmissiveTextureSums>(textures_, ref, scene_);
    const auto& uv = p.uv[ref.uv_set == 1 ? 1 : 0];
    if (uv.empty()) return full * sums_[index]->mean({}, {}, {});
    return full * sums_[index]->mean(uv[t[0]], uv[t[1]], uv[t[2]]);
  }

 private:
  const Scene& scene_;
  const TextureTable& textures_;
  std::vector<std::unique_ptr<EmissiveTextureSums>> sums_;  // by material
};

}  // namespace tessera::render
