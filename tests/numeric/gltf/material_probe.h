#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/gltf_probe.h"

/// Squares of one material under one light, viewed along the normal, and the values of the
/// specification's layers there.
namespace tessera::testing {

using render::Vec3d;

inline constexpr double kPi = 3.14159265358979323846;
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
  return 1 / (4 * kPi * std::pow(roughness, 4));
}

/// The specification's dielectric in that geometry: light not reflected at F0 reaches the base
/// colour.
inline Vec3d dielectric(const Vec3d& base, const Vec3d& f0, double roughness) {
  const double largest = std::max({f0.x, f0.y, f0.z});
  return base * ((1 - largest) / kPi) + f0 * facets(roughness);
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

}  // namespace tessera::testing
