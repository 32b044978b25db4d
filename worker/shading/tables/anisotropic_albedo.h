#pragma once

#include <array>
#include <cstddef>

#include "worker/math/vector.h"

namespace tessera::render {

/// Alpha along the direction of anisotropy; across it, alpha is the material's. `strength` in [0,
/// 1]. Source: KHR_materials_anisotropy.
constexpr float anisotropic_alpha(float alpha, float strength) {
  return alpha + (1 - alpha) * (strength * strength);
}

/// Directional albedo of perfectly reflecting anisotropic GGX facets; see albedo_table.h for
/// isotropic ones.
///
/// Grid: strength and roughness over [0, 1]; the viewer's direction in the stretched space of the
/// facets, w = normalize(alpha_t x, alpha_b y, z), where the albedo is smooth: w.z = (i / (n -
/// 1))^2, and the fraction (w.x^2) / (w.x^2 + w.y^2) of the tangent. Linear in between.
class AnisotropicAlbedo {
 public:
  AnisotropicAlbedo();

  /// Albedo for light leaving along `wo` (unit; the tangent is x).
  float at(const Vec3f& wo, float roughness, float strength) const;
  /// Cosine-weighted mean of at() over the hemisphere.
  float average(float roughness, float strength) const;

 private:
  static constexpr int kStrengths = 9, kRoughness = 13, kHeights = 12, kAzimuths = 4;

  void fill_averages();

  std::array<std::array<std::array<std::array<float, kAzimuths>, kHeights>, kRoughness>, kStrengths>
      values_{};
  std::array<std::array<float, kRoughness>, kStrengths> averages_{};
};

}  // namespace tessera::render
