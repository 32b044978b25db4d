#pragma once

#include <cstdint>
#include <vector>

#include "worker/shading/shading_scene.h"

namespace tessera::render {

/// Mean brightness of an emissive texture over uv boxes in constant time, for choosing triangles
/// by the light they give. Summed-area tables in double and of counts: exactly zero only where
/// every texel a bilinear lookup in the box can touch is black.
class EmissiveTextureSums {
 public:
  /// Requires a ref with a texture.
  EmissiveTextureSums(const TextureTable& textures, const TextureRef& ref, const Scene& scene);

  /// Mean luminance over the texels under the box of three uv points (before the transform).
  double mean(const Vec2f& a, const Vec2f& b, const Vec2f& c) const;

 private:
  double box(std::int32_t x0, std::int32_t x1, std::int32_t y0, std::int32_t y1) const;

  TextureRef ref_;
  std::int32_t width_ = 0, height_ = 0;
  bool repeats_u_ = true, repeats_v_ = true;
  std::vector<double> sums_;        // (width + 1) x (height + 1)
  std::vector<std::uint32_t> lit_;  // texels that are not black
};

}  // namespace tessera::render
