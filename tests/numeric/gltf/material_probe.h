#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "tests/support/render/gltf_probe.h"

/// Squares of one material under one light, viewed along the normal, and the values of the
/// specification's layers there.
namespace tessera::testing {

using render::Vec3d;

inline constexpr double kX = 0.3, kY = 0.6;  // visible spot; not on the diagonal

/// The linear value of an 8-bit sRGB code. Source: IEC 61966-2-1.
inline double linear(int code) {
  const double v = code / 255.0;
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

inline void expect_near(const Vec3d& got, const Vec3d& want, double relative) {
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(got[k], want[k], relative * std::fabs(want[k]) + 1e-7);
}

/// Radiance of a square of `material` (JSON) under a sun of 1 lux along its normal, or turned by
/// `sun_rotation` (JSON, a quaternion); texture 0, which the material may use, has one texel.
inline Vec3d lit(const std::string& material,
                 const std::vector<std::uint8_t>& texel = {0, 0, 0, 255},
                 const std::string& sun_rotation = "[0, 0, 0, 1]") {
  const auto file = probe_of(kX, kY);
  file->add_texture(file->add_image(png(1, 1, texel), ""));
  add_sun(*file, 1);
  file->set("/nodes/1/rotation", sun_rotation);
  file->add_node_with_mesh(file->add_mesh(unit_quad(file->add_material(material))));
  return seen(*file, probe_settings());
}

/// D V of the specification's GGX with light, view and facet along the normal: D = 1 / (pi
/// alpha^2), V = 1/4.
inline double facets(double roughness) {
  return 1 / (4 * std::numbers::pi * std::pow(roughness, 4));
}

/// Albedo of the specification's facets under Schlick's term of `f0`, in double, for a viewer at
/// `cosine`: over the visible normals, sampled in the space where the facets are a hemisphere.
/// Source: E. Heitz, "Sampling the GGX Distribution of Visible Normals", JCGT 7(4), 2018.
inline double facet_albedo(double cosine, double f0, double alpha) {
  constexpr int kRings = 96, kSpokes = 48;
  const double sine = std::sqrt((1 - cosine) * (1 + cosine)), a2 = alpha * alpha;
  const Vec3d view = normalize(Vec3d{alpha * sine, 0, cosine});
  const Vec3d across{0, 1, 0}, along = cross(view, across);
  const double root_o = std::sqrt(a2 + (1 - a2) * cosine * cosine);
  double sum = 0;
  for (int i = 0; i < kRings; ++i) {
    const double v = (i + 0.5) / kRings, r = std::sqrt((1 - v) * (1 + v)), weight = 2 * v;
    for (int j = 0; j < kSpokes; ++j) {
      const double phi = 2 * std::numbers::pi * (j + 0.5 + 0.618 * i) / kSpokes;
      const double x = r * std::sin(phi), rim = std::sqrt((1 - x) * (1 + x));
      const double y = (1 - (1 + view.z) / 2) * rim + (1 + view.z) / 2 * r * std::cos(phi);
      const double z = std::sqrt(std::max(0.0, 1 - x * x - y * y));
      const Vec3d n = across * x + along * y + view * z;
      const Vec3d h = normalize(Vec3d{alpha * n.x, alpha * n.y, std::max(1e-9, n.z)});
      const double c = sine * h.x + cosine * h.z, l = 2 * c * h.z - cosine;
      if (!(l > 0)) continue;
      const double root_l = std::sqrt(a2 + (1 - a2) * l * l);
      sum += weight * (f0 + (1 - f0) * std::pow(1 - c, 5)) * l * (cosine + root_o) /
             (l * root_o + cosine * root_l);
    }
  }
  return sum / (kRings * kSpokes);
}

/// Share of the light that a layer of reflectance `f0` at normal incidence leaves to the base, for
/// light and view along the normal: (1 - E)^2 / (1 - mean of E), times the layer's weight in E.
inline double left_to_base(double f0, double roughness, double weight = 1) {
  const double alpha = roughness * roughness, e = weight * facet_albedo(1, f0, alpha);
  constexpr int kSteps = 48;
  double mean = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double x = (i + 0.5) / kSteps;  // the cosine is its square
    mean += weight * 4 * x * x * x / kSteps * facet_albedo(x * x, f0, alpha);
  }
  return (1 - e) * (1 - e) / (1 - mean);
}

/// The dielectric in that geometry: facets as specified, and the base coupled with them.
inline Vec3d dielectric(const Vec3d& base, const Vec3d& f0, double roughness, double weight = 1) {
  const double largest = std::max({f0.x, f0.y, f0.z});
  return base * (left_to_base(largest, roughness, weight) / std::numbers::pi) +
         f0 * (weight * facets(roughness));
}

inline std::string with(const std::string& extension, const std::string& content,
                        const std::string& core = R"("baseColorFactor": [0.8, 0.4, 0.2, 1])",
                        double roughness = 0.5, double metallic = 0) {
  return R"({"pbrMetallicRoughness": {)" + core + R"(, "metallicFactor": )" +
         std::to_string(metallic) + R"(, "roughnessFactor": )" + std::to_string(roughness) + "}" +
         (extension.empty() ? "" : R"(, "extensions": {")" + extension + "\": " + content + "}") +
         "}";
}

/// A closed box from z = -1 to 1, wider than the square.
inline TriangleMesh box_around_unit_square(int material) {
  TriangleMesh box;
  for (int i = 0; i < 8; ++i) {
    box.positions.push_back(
        {(i & 1) != 0 ? 2.0f : -1.0f, (i & 2) != 0 ? 2.0f : -1.0f, (i & 4) != 0 ? 1.0f : -1.0f});
  }
  box.indices = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
  box.material = material;
  return box;
}

inline constexpr Vec3d kBase{0.8, 0.4, 0.2};
inline constexpr Vec3d kPlain{0.04, 0.04, 0.04};  // F0 of index 1.5
inline constexpr double kRounding = 1e-5;         // of a few dozen float operations
inline constexpr double kCoupled =
    2e-3;  // of tables of albedos, for the light that reaches the base

}  // namespace tessera::testing
