#pragma once

#include <cmath>
#include <cstddef>

#include "worker/math/vector.h"
#include "worker/shading/tables/facet_albedo.h"

namespace tessera::render {

/// Alpha along the direction of anisotropy; across it, alpha is the material's. `strength` in [0,
/// 1]. Source: KHR_materials_anisotropy.
template <typename T>
constexpr T anisotropic_alpha(T alpha, T strength) {
  return alpha + (1 - alpha) * (strength * strength);
}

/// Like FacetAlbedo, for anisotropic facets; also rounded up.
///
/// Grid: roughness across as albedo_grid::fineness_of(); that along, between it and 1, likewise;
/// that in the vertical plane of the viewer, between both, likewise; the cosine as
/// albedo_grid::height_of() with the alpha in that plane. Linear in between.
class AnisotropicAlbedo {
 public:
  static constexpr std::size_t kAlphas = 9, kRows = 17, kPlanes = 9, kHeights = 32;

  /// Alpha along the tangent at coordinate `x` in [0, 1], if it is `alpha_b` across.
  static double alpha_t_of(double x, double alpha_b) {
    const double least = albedo_grid::fineness_of(std::sqrt(alpha_b));
    const double root = albedo_grid::roughness_of(lerp(least, 1.0, x));
    return root * root;
  }

  AnisotropicAlbedo() = default;
  AnisotropicAlbedo(float roughness, float strength);

  /// Albedo for light leaving along `w` (unit; the tangent is x; either side).
  FacetAlbedo at(const Vec3f& w) const;
  /// Cosine-weighted mean of at() over the hemisphere; not rounded up.
  FacetAlbedo mean() const;

 private:
  std::size_t first_ = 0;  // roughness along and across below
  float along_ = 0, row_ = 0;
  float alpha_t_ = 1, alpha_b_ = 1;
  float fine_t_ = 0, fine_b_ = 0;
};

}  // namespace tessera::render
