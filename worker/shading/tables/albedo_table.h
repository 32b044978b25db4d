#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace tessera::render {

/// Directional albedo of a single-scattering GGX lobe over (cosine, roughness): the fraction of
/// light that leaves without a second bounce between microfacets. Computed in double by fixed
/// quadrature with exactly rounded operations, so all machines have the same bits.
///
/// Grid: kCosines points in cos = (i / (n - 1))^2 and kRoughness points in roughness = sqrt(alpha),
/// both over [0, 1]; bilinear in between.
class AlbedoTable {
 public:
  static constexpr int kCosines = 24, kRoughness = 24;
  static constexpr std::size_t kSize = std::size_t{kCosines} * kRoughness;

  AlbedoTable() = default;

  /// Perfectly reflecting facets (F = 1): E(1, alpha 1) = 1 - ln 2.
  static AlbedoTable reflector();
  /// Reflection plus transmission at a dielectric with relative index `eta` > 0, as scattered by
  /// worker/shading/bsdf/bsdf.h. Never above 1.
  static AlbedoTable dielectric(double eta);

  /// Albedo for light leaving at `cos_theta` in [0, 1] from a lobe of `roughness` in [0, 1].
  float at(float cos_theta, float roughness) const;
  /// 2 * integral of at(c, roughness) c dc, over [0, 1].
  float average(float roughness) const;

 private:
  void fill_averages();

  std::array<float, kSize> values_{};  // [roughness][cosine]
  std::array<float, kRoughness> averages_{};
};

}  // namespace tessera::render
