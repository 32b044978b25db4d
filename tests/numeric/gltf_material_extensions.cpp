/// What the extensions of layers and lobes say of a material, from the file to the pixel: a closed
/// form for each number and texture, and another result without it.

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/numeric/material_probe.h"

namespace tessera::testing {
namespace {

const std::string kGrey = R"("baseColorFactor": [0.5, 0.5, 0.5, 1])";

/// A quaternion (JSON) that turns the sun by `angle` radians so that light comes from
/// (sin, 0, cos) `towards_x`, or from (0, sin, cos).
std::string turned(double angle, bool towards_x = true) {
  const std::string s = std::to_string(std::sin(angle / 2)),
                    c = std::to_string(std::cos(angle / 2));
  return towards_x ? "[0, " + s + ", 0, " + c + "]" : "[-" + s + ", 0, 0, " + c + "]";
}

/// The specification's GGX for facets of roughness `along_x` and `along_y` (each the square root of
/// an alpha), seen along the normal, light from `l`: D V.
double facets_towards(const Vec3d& l, double along_x, double along_y) {
  const double at = along_x * along_x, ab = along_y * along_y;
  const Vec3d h = normalize(l + Vec3d{0, 0, 1});
  const double q = h.x * h.x / (at * at) + h.y * h.y / (ab * ab) + h.z * h.z;
  const double d = 1 / (kPi * at * ab * q * q);
  const double root = std::sqrt(at * at * l.x * l.x + ab * ab * l.y * l.y + l.z * l.z);
  return d * 0.5 / (l.z + root);
}

TEST(GltfClearcoat, ReflectsAtTwentyFifthAndDimsTheRest) {
  const auto coated = [](double factor, double roughness) {
    return lit(with("KHR_materials_clearcoat", R"({"clearcoatFactor": )" + std::to_string(factor) +
                                                   R"(, "clearcoatRoughnessFactor": )" +
                                                   std::to_string(roughness) + "}"));
  };
  const Vec3d below = dielectric(kBase, kPlain, 0.5);
  for (const double factor : {1.0, 0.5}) {
    const double w = 0.04 * factor;
    const Vec3d coat = Vec3d{1, 1, 1} * (w * facets(0.3));
    expect_near(coated(factor, 0.3), below * (1 - w) + coat, kRounding);
    // Without roughness, the default, the coat is a mirror, which shows no sun.
    expect_near(coated(factor, 0), below * (1 - w), kRounding);
  }
  EXPECT_EQ(coated(0, 0.3), lit(with("", "")));
}

TEST(GltfClearcoat, TakesItsFresnelTermAtItsOwnNormal) {
  // The view along the normal of the surface meets a coat tilted by its map; the base stays.
  const std::vector<std::uint8_t> texel = {179, 128, 230, 255};
  const double z = 2 * 230 / 255.0 - 1, x = 2 * 179 / 255.0 - 1, y = 2 * 128 / 255.0 - 1;
  const auto expected = [&](double scale) {
    const Vec3d n = normalize(Vec3d{x * scale, -y * scale, z});  // v runs against y
    const double w = 0.04 + 0.96 * std::pow(1 - n.z, 5);
    // Light and view along +z: both at angle acos(n.z) to the coat's normal, h = +z.
    const double a2 = std::pow(0.6, 4), q = 1 + n.z * n.z * (a2 - 1);
    const double d = a2 / (kPi * q * q);
    const double visibility = 0.25 / (n.z * std::sqrt(a2 + (1 - a2) * n.z * n.z));
    const double coat = w * d * visibility * n.z;
    return Vec3d{1, 1, 1} * ((1 - w) * 0.5 / kPi + coat);
  };
  const auto coated = [&](const std::string& scale) {
    return lit(R"({"pbrMetallicRoughness": {)" + kGrey + R"(, "metallicFactor": 0}, "extensions": {
        "KHR_materials_specular": {"specularFactor": 0}, "KHR_materials_clearcoat":
        {"clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.6, "clearcoatNormalTexture":
        {"index": 0)" +
                   scale + "}}}}",
               texel);
  };
  expect_near(coated(""), expected(1), 1e-4);
  expect_near(coated(R"(, "scale": 0.5)"), expected(0.5), 1e-4);
}

TEST(GltfClearcoat, DimsEmissionBelowIt) {
  const std::string glowing = R"({"emissiveFactor": [1, 0.5, 0.25], "pbrMetallicRoughness":
      {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0}, "extensions": {
      "KHR_materials_specular": {"specularFactor": 0}, "KHR_materials_clearcoat": {)";
  expect_near(lit(glowing + R"("clearcoatFactor": 1}}})"), Vec3d{1, 0.5, 0.25} * 0.96, kRounding);
  expect_near(lit(glowing + R"("clearcoatFactor": 0.25}}})"), Vec3d{1, 0.5, 0.25} * 0.99,
              kRounding);
}

TEST(GltfClearcoat, OfGlassIsOnItsOutsideOnly) {
  // Straight through a box of matched index: 4 % lost at the coat of the face that is entered.
  const auto through = [](const std::string& coat) {
    const auto file = probe_of(kX, kY);
    const int material = file->add_material(
        R"({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0}, "extensions": {
            "KHR_materials_ior": {"ior": 1}, "KHR_materials_volume": {"thicknessFactor": 1},
            "KHR_materials_transmission": {"transmissionFactor": 1})" +
        coat + "}}");
    file->add_node_with_mesh(file->add_mesh(box_around_unit_square(material)));
    const int lamp = file->add_material(
        R"({"emissiveFactor": [1, 1, 1], "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}})");
    file->add_node_with_mesh(file->add_mesh(unit_quad(lamp)), R"({"translation": [0, 0, -2]})");
    contract::RenderSettings settings = probe_settings();
    settings.max_depth = 4;
    settings.spp = 4096;
    return seen(*file, settings);
  };
  const std::string coat = R"(, "KHR_materials_clearcoat": {"clearcoatFactor": 1})";
  expect_near(through(""), {1, 1, 1}, 1e-5);
  // One sample in 20 goes to the coat: a standard deviation of 0.23, four standard errors.
  expect_near(through(coat), {0.96, 0.96, 0.96}, 4 * 0.23 / 64);
}

/// What texture 0 does where a slot names it, and the factors it stands for.
void expect_texture(const std::string& slot, const std::string& plain,
                    const std::vector<std::uint8_t>& texel, const std::string& sun) {
  const Vec3d want = lit(plain, texel, sun);
  expect_near(lit(slot, texel, sun), want, 1e-4);  // six decimals of the factors as text
  const Vec3d white = lit(slot, {255, 255, 255, 255}, sun);
  EXPECT_GT(std::fabs(white.x - want.x), 1e-3 * want.x) << "the texture changes the result";
}

TEST(GltfClearcoat, TexturesMultiplyTheirFactorsByTheirOwnChannels) {
  const std::vector<std::uint8_t> texel = {51, 102, 204, 128};
  const auto coat = [](const std::string& content) {
    return with("KHR_materials_clearcoat", "{" + content + "}", kGrey);
  };
  expect_texture(coat(R"("clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.4,
                         "clearcoatTexture": {"index": 0})"),
                 coat(R"("clearcoatFactor": 0.1, "clearcoatRoughnessFactor": 0.4)"), texel,
                 turned(0));
  expect_texture(coat(R"("clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.5,
                         "clearcoatRoughnessTexture": {"index": 0})"),
                 coat(R"("clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.2)"), texel,
                 turned(0));
}

TEST(GltfClearcoat, HighlightFollowsItsRoughness) {
  const double angle = 0.5;
  const Vec3d l{std::sin(angle), 0, std::cos(angle)};
  const std::string black = R"("baseColorFactor": [0, 0, 0, 1])";
  for (const double roughness : {0.4, 0.7, 1.0}) {
    const std::string coated = R"({"pbrMetallicRoughness": {)" + black +
                               R"(, "metallicFactor": 0}, "extensions": {
        "KHR_materials_specular": {"specularFactor": 0}, "KHR_materials_clearcoat":
        {"clearcoatFactor": 1, "clearcoatRoughnessFactor": )" +
                               std::to_string(roughness) + "}}}";
    const double want = 0.04 * facets_towards(l, roughness, roughness) * l.z;
    expect_near(lit(coated, {0, 0, 0, 255}, turned(angle)), Vec3d{want, want, want}, 2e-5);
  }
}

}  // namespace
}  // namespace tessera::testing
