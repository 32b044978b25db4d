/// glTF material extensions for layers and lobes, from the file to the pixel: a formula for each
/// number and texture, and another result without it.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "tests/numeric/gltf/material_probe.h"
#include "worker/shading/microfacet/thin_film.h"

namespace tessera::testing {
namespace {

std::string grey() {
  return R"("baseColorFactor": [0.5, 0.5, 0.5, 1])";
}

/// A quaternion (JSON) that turns the sun by `angle` radians, so that light comes from (sin, 0,
/// cos) if `towards_x`, else from (0, sin, cos).
std::string turned(double angle, bool towards_x = true) {
  const std::string s = std::to_string(std::sin(angle / 2)),
                    c = std::to_string(std::cos(angle / 2));
  return towards_x ? "[0, " + s + ", 0, " + c + "]" : "[-" + s + ", 0, 0, " + c + "]";
}

/// The specification's GGX for roughness `along_x` and `along_y` (each the square root of an
/// alpha), viewed along the normal, light from `l`: D V.
double facets_towards(const Vec3d& l, double along_x, double along_y) {
  const double at = along_x * along_x, ab = along_y * along_y;
  const Vec3d h = normalize(l + Vec3d{0, 0, 1});
  const double q = h.x * h.x / (at * at) + h.y * h.y / (ab * ab) + h.z * h.z;
  const double d = 1 / (std::numbers::pi * at * ab * q * q);
  const double root = std::sqrt(at * at * l.x * l.x + ab * ab * l.y * l.y + l.z * l.z);
  return d * 0.5 / (l.z + root);
}

TEST(GltfClearcoat, Reflects4PercentAndDimsBase) {
  const auto coated = [](double factor, double roughness) {
    return lit(with("KHR_materials_clearcoat", R"({"clearcoatFactor": )" + std::to_string(factor) +
                                                   R"(, "clearcoatRoughnessFactor": )" +
                                                   std::to_string(roughness) + "}"));
  };
  const Vec3d below = dielectric(kBase, kPlain, 0.5);
  for (const double factor : {1.0, 0.5}) {
    const double w = 0.04 * factor;
    const Vec3d coat = Vec3d{1, 1, 1} * (w * facets(0.3));
    expect_near(coated(factor, 0.3), below * (1 - w) + coat, kCoupled);
    // With the default roughness 0 the coat is a mirror, which does not show the sun.
    expect_near(coated(factor, 0), below * (1 - w), kCoupled);
  }
  EXPECT_EQ(coated(0, 0.3), lit(with("", "")));
}

TEST(GltfClearcoat, FresnelUsesCoatNormal) {
  // The view along the surface normal hits a coat tilted by its map; the base is not tilted.
  const std::vector<std::uint8_t> texel = {179, 128, 230, 255};
  const double z = 2 * 230 / 255.0 - 1, x = 2 * 179 / 255.0 - 1, y = 2 * 128 / 255.0 - 1;
  const auto expected = [&](double scale) {
    const Vec3d n = normalize(Vec3d{x * scale, -y * scale, z});  // v runs against y
    const double w = 0.04 + 0.96 * std::pow(1 - n.z, 5);
    // Light and view along +z: both at angle acos(n.z) to the coat's normal, h = +z.
    const double a2 = std::pow(0.6, 4), q = 1 + n.z * n.z * (a2 - 1);
    const double d = a2 / (std::numbers::pi * q * q);
    const double visibility = 0.25 / (n.z * std::sqrt(a2 + (1 - a2) * n.z * n.z));
    const double coat = w * d * visibility * n.z;
    return Vec3d{1, 1, 1} * ((1 - w) * 0.5 / std::numbers::pi + coat);
  };
  const auto coated = [&](const std::string& scale) {
    return lit(R"({"pbrMetallicRoughness": {)" + grey() +
                   R"(, "metallicFactor": 0}, "extensions": {
        "KHR_materials_specular": {"specularFactor": 0}, "KHR_materials_clearcoat":
        {"clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.6, "clearcoatNormalTexture":
        {"index": 0)" +
                   scale + "}}}}",
               texel);
  };
  expect_near(coated(""), expected(1), 1e-4);
  expect_near(coated(R"(, "scale": 0.5)"), expected(0.5), 1e-4);
}

TEST(GltfClearcoat, DimsEmissionBelow) {
  const std::string glowing = R"({"emissiveFactor": [1, 0.5, 0.25], "pbrMetallicRoughness":
      {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0}, "extensions": {
      "KHR_materials_specular": {"specularFactor": 0}, "KHR_materials_clearcoat": {)";
  expect_near(lit(glowing + R"("clearcoatFactor": 1}}})"), Vec3d{1, 0.5, 0.25} * 0.96, kRounding);
  expect_near(lit(glowing + R"("clearcoatFactor": 0.25}}})"), Vec3d{1, 0.5, 0.25} * 0.99,
              kRounding);
}

TEST(GltfClearcoat, CoatsGlassOnOutsideOnly) {
  // Straight through a box of matched index: the coat reflects 4 % at the front face.
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
  // One sample in 20 chooses the coat: a standard deviation of 0.23, four standard errors.
  expect_near(through(coat), {0.96, 0.96, 0.96}, 4 * 0.23 / 64);
}

/// Expects a texture in `slot` to equal the factors that its texel stands for.
void expect_texture(const std::string& slot, const std::string& plain,
                    const std::vector<std::uint8_t>& texel, const std::string& sun) {
  const Vec3d want = lit(plain, texel, sun);
  expect_near(lit(slot, texel, sun), want, 1e-4);  // factors are written with six decimals
  const Vec3d white = lit(slot, {255, 255, 255, 255}, sun);
  EXPECT_GT(std::fabs(white.x - want.x), 1e-3 * want.x) << "the texture changes the result";
}

TEST(GltfClearcoat, TextureChannelsScaleFactors) {
  const std::vector<std::uint8_t> texel = {51, 102, 204, 128};
  const auto coat = [](const std::string& content) {
    return with("KHR_materials_clearcoat", "{" + content + "}", grey());
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

TEST(GltfClearcoat, HighlightFollowsRoughness) {
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

/// A black base with a specular layer of F0 0.04.
std::string black_with(const std::string& extension, const std::string& content) {
  return with(extension, content, R"("baseColorFactor": [0, 0, 0, 1])", 0.5);
}

TEST(GltfAnisotropy, HighlightStretchesAlongDirection) {
  // Tangents follow the coordinates u = x, v = y; the bitangent runs against v.
  const double angle = 0.6, roughness = 0.5, alpha = 0.25;
  const auto expected = [&](double strength, double rotation, const Vec3d& l) {
    const Vec3d along{std::cos(rotation), -std::sin(rotation), 0};
    const Vec3d across{-along.y, along.x, 0};
    const double at = alpha + (1 - alpha) * strength * strength;
    const double f = 0.04 + 0.96 * std::pow(1 - std::cos(angle / 2), 5);
    return f * l.z * facets_towards({dot(l, along), dot(l, across), l.z}, std::sqrt(at), roughness);
  };
  const auto brushed = [&](const std::string& content, bool towards_x,
                           const std::vector<std::uint8_t>& texel = {0, 0, 0, 255}) {
    return lit(black_with("KHR_materials_anisotropy", content), texel, turned(angle, towards_x)).x;
  };
  const Vec3d from_x{std::sin(angle), 0, std::cos(angle)}, from_y{0, from_x.x, from_x.z};
  const auto near = [](double got, double want) { EXPECT_NEAR(got, want, 1e-4 * want); };
  near(brushed(R"({"anisotropyStrength": 0.8})", true), expected(0.8, 0, from_x));
  near(brushed(R"({"anisotropyStrength": 0.8})", false), expected(0.8, 0, from_y));
  near(brushed(R"({"anisotropyStrength": 0.8, "anisotropyRotation": 0.7})", true),
       expected(0.8, 0.7, from_x));
  near(brushed(R"({"anisotropyStrength": 0.8, "anisotropyRotation": 0.7})", false),
       expected(0.8, 0.7, from_y));
  near(brushed(R"({"anisotropyStrength": 0})", true), expected(0, 0, from_x));
  const std::vector<std::uint8_t> texel = {204, 51, 128, 255};
  near(brushed(R"({"anisotropyStrength": 0.8, "anisotropyRotation": 0.3,
                   "anisotropyTexture": {"index": 0}})",
               true, texel),
       expected(0.8 * 128 / 255.0, 0.3 + std::atan2(-0.6, 0.6), from_x));
}

/// Estevez & Kulla's Lambda, from the text of the extension.
double fibre_lambda(double cosine, double alpha) {
  const auto curve = [alpha](double x) {
    const double k = (1 - alpha) * (1 - alpha);
    const auto mix = [k](double a, double b) { return a * (1 - k) + b * k; };
    return mix(21.5473, 25.3245) /
               (1 + mix(3.82987, 3.32435) * std::pow(x, mix(0.19823, 0.16801))) +
           mix(-1.97760, -1.27393) * x + mix(-4.32054, -4.85967);
  };
  return std::exp(cosine < 0.5 ? curve(cosine) : 2 * curve(0.5) - curve(1 - cosine));
}

/// White sheen for two directions.
double fibres(const Vec3d& v, const Vec3d& l, double roughness) {
  const double alpha = roughness * roughness;
  const Vec3d h = normalize(v + l);
  const double d = (2 + 1 / alpha) * std::pow(1 - h.z * h.z, 0.5 / alpha) / (2 * std::numbers::pi);
  return d / ((1 + fibre_lambda(v.z, alpha) + fibre_lambda(l.z, alpha)) * 4 * v.z * l.z);
}

double fibre_albedo(double cosine, double roughness) {
  constexpr int kSteps = 400;
  const Vec3d v{std::sqrt(1 - cosine * cosine), 0, cosine};
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double z = (i + 0.5) / kSteps, s = std::sqrt(1 - z * z);
    for (int k = 0; k < kSteps; ++k) {
      const double phi = std::numbers::pi * (k + 0.5) / kSteps;
      sum += z * fibres(v, {s * std::cos(phi), s * std::sin(phi), z}, roughness);
    }
  }
  return sum * 2 * std::numbers::pi / kSteps / kSteps;
}

std::string sheen(const std::string& content) {
  return R"({"pbrMetallicRoughness": {)" + grey() +
         R"(, "metallicFactor": 0}, "extensions": {
      "KHR_materials_specular": {"specularFactor": 0}, "KHR_materials_sheen": {)" +
         content + "}}}";
}

TEST(GltfSheen, DimsBaseByItsAlbedo) {
  for (const double angle : {0.5, 1.3}) {
    const Vec3d v{0, 0, 1}, l{std::sin(angle), 0, std::cos(angle)};
    for (const double roughness : {0.3, 0.6, 1.0}) {
      const double largest = std::max(fibre_albedo(1, roughness), fibre_albedo(l.z, roughness));
      const Vec3d color{0.8, 0.4, 0.1};
      const Vec3d want = (color * fibres(v, l, roughness) +
                          Vec3d{1, 1, 1} * (0.5 / std::numbers::pi * (1 - 0.8 * largest))) *
                         l.z;
      const Vec3d got =
          lit(sheen(R"("sheenColorFactor": [0.8, 0.4, 0.1], "sheenRoughnessFactor": )" +
                    std::to_string(roughness)),
              {0, 0, 0, 255}, turned(angle));
      // Bilinear interpolation of the table: 2e-3 of the base's value.
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(got[k], want[k], 2e-3 * want[k]) << roughness;
    }
  }
  EXPECT_EQ(lit(sheen(R"("sheenRoughnessFactor": 0.5)")), (Vec3d{1, 1, 1} * lit(sheen("")).x));
}

TEST(GltfSheen, TextureChannelsScaleFactors) {
  const std::vector<std::uint8_t> texel = {51, 102, 204, 128};
  const auto text = [](double x) { return std::to_string(x); };
  expect_texture(
      sheen(R"("sheenColorFactor": [0.5, 0.5, 0.5], "sheenRoughnessFactor": 0.5,
                          "sheenColorTexture": {"index": 0})"),
      sheen(R"("sheenRoughnessFactor": 0.5, "sheenColorFactor": [)" + text(0.5 * linear(51)) + "," +
            text(0.5 * linear(102)) + "," + text(0.5 * linear(204)) + "]"),
      texel, turned(1.2));
  expect_texture(
      sheen(R"("sheenColorFactor": [0.5, 0.5, 0.5], "sheenRoughnessFactor": 1,
                          "sheenRoughnessTexture": {"index": 0})"),
      sheen(R"("sheenColorFactor": [0.5, 0.5, 0.5], "sheenRoughnessFactor": )" + text(128 / 255.0)),
      texel, turned(1.2));
}

/// Radiance through a prism of 20 degrees and index 1.5 with Abbe number 10; the lamp covers the
/// directions beyond that of 549 nm light. The ray enters along the normal of the front.
Vec3d through_a_prism(double dispersion) {
  const double apex = std::numbers::pi / 9, slope = std::tan(apex);
  const auto file = probe_of(kX, kY);
  const int glass = file->add_material(
      R"({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0}, "extensions": {
          "KHR_materials_volume": {"thicknessFactor": 1},
          "KHR_materials_transmission": {"transmissionFactor": 1},
          "KHR_materials_dispersion": {"dispersion": )" +
      std::to_string(dispersion) + "}}}");
  TriangleMesh prism = box_around_unit_square(glass);
  for (auto& x : prism.positions) {
    x.z = x.z > 0 ? 1.0f : static_cast<float>(-1 - slope * (static_cast<double>(x.x) - kX));
  }
  file->add_node_with_mesh(file->add_mesh(prism));
  const double index = 1.5 + 0.05 * (523655 / (549.0 * 549) - 1.5168);
  const double edge = kX + 4 * std::tan(std::asin(index * std::sin(apex)) - apex);
  const int lamp = file->add_material(
      R"({"emissiveFactor": [1, 1, 1], "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}})");
  TriangleMesh quad = unit_quad(lamp);
  file->add_node_with_mesh(file->add_mesh(quad), R"({"scale": [9, 9, 1], "translation": [)" +
                                                     std::to_string(edge) + ", -4, -5]}");
  contract::RenderSettings settings = probe_settings();
  settings.max_depth = 2;
  settings.spp = 65536;
  return seen(*file, settings);
}

TEST(GltfDispersion, PrismBendsBlueMoreThanRed) {
  // All of blue's band lies below 549 nm, nothing of red's, and of green's triangle, which peaks at
  // 549 nm, the part between 464 and 549 nm. Four standard errors of 65,536 samples: 2 %.
  const double passed = 0.96 * (1 - 0.0443);  // both faces; the second at 20 degrees
  const Vec3d got = through_a_prism(2);
  EXPECT_EQ(got.x, 0);
  EXPECT_NEAR(got.y, passed * (549.0 - 464) / (611 - 464), 0.02);
  EXPECT_NEAR(got.z, passed, 0.02);
  EXPECT_EQ(through_a_prism(0), (Vec3d{0, 0, 0}));
}

TEST(GltfDispersion, ZeroKeepsEveryBit) {  // hard case 54
  const auto prism = [](const std::string& extension) {
    const auto file = probe_of(kX, kY);
    file->add_node_with_mesh(file->add_mesh(box_around_unit_square(file->add_material(
        R"({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.2}, "extensions": {
            "KHR_materials_volume": {"thicknessFactor": 1}, )" +
        extension + R"("KHR_materials_transmission": {"transmissionFactor": 1}}})"))));
    const int lamp = file->add_material(R"({"emissiveFactor": [1, 0.5, 0.25]})");
    file->add_node_with_mesh(file->add_mesh(unit_quad(lamp)),
                             R"({"scale": [9, 9, 1], "translation": [-4, -4, -5]})");
    contract::RenderSettings settings = probe_settings();
    settings.max_depth = 8;
    settings.spp = 256;
    return seen(*file, settings);
  };
  const Vec3d none = prism("");
  EXPECT_GT(none.x, 0.5);
  EXPECT_EQ(prism(R"("KHR_materials_dispersion": {"dispersion": 0}, )"), none);
  EXPECT_NE(prism(R"("KHR_materials_dispersion": {"dispersion": 1}, )"), none);
}

TEST(GltfIridescence, ZeroThicknessKeepsEveryBit) {  // hard case 54
  // Also under a grazing sun, 70 degrees off the normal: without thickness there is no film, while
  // the formula of a film of index 1 has Schlick's reflectance there.
  const std::string sun = "[0, 0.5735764364, 0, 0.8191520443]";
  const auto under = [&](const std::string& film) {
    return lit(with(film.empty() ? "" : "KHR_materials_iridescence", film), {0, 0, 0, 255}, sun);
  };
  const Vec3d bare = under("");
  EXPECT_GT(bare.x, 0.01);
  EXPECT_EQ(under(R"({"iridescenceFactor": 1, "iridescenceThicknessMaximum": 0})"), bare);
  EXPECT_NE(under(R"({"iridescenceFactor": 1, "iridescenceThicknessMaximum": 300})"), bare);
}

/// The extension's film over a base of reflectance f0, at normal incidence, in double.
double film_term(double f0, double ior, double thickness, int channel) {
  const auto square = [](double x) { return x * x; };
  const double r12 = square((ior - 1) / (ior + 1)), t121 = 1 - r12;
  const double base = (1 + std::sqrt(f0)) / (1 - std::sqrt(f0));
  const double r23 = square((base - ior) / (base + ior));
  const double shift = std::numbers::pi + (base < ior ? std::numbers::pi : 0);
  const double r123 = r12 * r23, rs = t121 * t121 * r23 / (1 - r123);
  const double value[4] = {5.4856e-13, 4.4201e-13, 5.2481e-13, 9.7470e-14};
  const double position[4] = {1.6810e+06, 1.7953e+06, 2.2084e+06, 2.2399e+06};
  const double variance[4] = {4.3278e+09, 9.3046e+09, 6.6121e+09, 4.5282e+09};
  const double matrix[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                               {-0.9692660, 1.8760108, 0.0415560},
                               {0.0556434, -0.2040259, 1.0572252}};
  double sum = r12 + rs, amplitude = rs - t121;
  for (int m = 1; m <= 2; ++m) {
    amplitude *= std::sqrt(r123);
    const double phase = 2 * std::numbers::pi * m * 2 * ior * thickness * 1e-9;
    double xyz[3] = {};
    for (int g = 0; g < 4; ++g) {
      xyz[g % 3] += value[g] * std::sqrt(2 * std::numbers::pi * variance[g]) *
                    std::cos(position[g] * phase + m * shift) *
                    std::exp(-phase * phase * variance[g]) / 1.0685e-7;
    }
    const double* row = matrix[channel];
    sum += 2 * amplitude * (row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2]);
  }
  return std::clamp(sum, 0.0, 1.0);
}

Vec3d film_terms(const Vec3d& f0, double ior, double thickness, double factor) {
  Vec3d f;
  for (int k = 0; k < 3; ++k) f[k] = f0[k] + factor * (film_term(f0[k], ior, thickness, k) - f0[k]);
  return f;
}

TEST(GltfIridescence, FilmThicknessColoursReflection) {
  const std::vector<std::uint8_t> texel = {128, 51, 0, 255};
  const auto film = [&](double metallic, const std::string& content) {
    return lit(with("KHR_materials_iridescence", "{" + content + "}",
                    R"("baseColorFactor": [0.8, 0.4, 0.2, 1])", 0.2, metallic),
               texel);
  };
  // The base gets what the lowest Fresnel term of Schlick's form leaves that covers the film's.
  const auto mixed = [](double ior, double thickness, double factor) {
    const Vec3d f = film_terms(kPlain, ior, thickness, factor);
    const double cap = static_cast<double>(render::thin_film_cap(
        {1, static_cast<float>(ior), static_cast<float>(thickness)}, {0.04f, 0.04f, 0.04f}, 0));
    EXPECT_GE(cap * factor + 0.04 * (1 - factor), std::max({f.x, f.y, f.z}) - 1e-3);
    return kBase * (left_to_base(0.04 + factor * (cap - 0.04), 0.2) / std::numbers::pi) +
           f * facets(0.2);
  };
  expect_near(film(1, R"("iridescenceFactor": 1)"), film_terms(kBase, 1.3, 400, 1) * facets(0.2),
              1e-3);
  expect_near(film(0, R"("iridescenceFactor": 1)"), mixed(1.3, 400, 1), kCoupled);
  expect_near(film(0, R"("iridescenceFactor": 0.5, "iridescenceIor": 1.8,
                         "iridescenceThicknessMaximum": 550)"),
              mixed(1.8, 550, 0.5), kCoupled);
  expect_near(film(0, R"("iridescenceFactor": 1, "iridescenceTexture": {"index": 0})"),
              mixed(1.3, 400, 128 / 255.0), kCoupled);
  // The cap of a thickness from a texture is the larger of two neighbouring ones.
  expect_near(film(0, R"("iridescenceFactor": 1, "iridescenceThicknessMinimum": 200,
                         "iridescenceThicknessMaximum": 700,
                         "iridescenceThicknessTexture": {"index": 0})"),
              mixed(1.3, 300, 1), 2e-2);
  // Without a film there is no effect: hard case 54.
  EXPECT_EQ(film(0, R"("iridescenceFactor": 1, "iridescenceThicknessMaximum": 0)"),
            film(0, R"("iridescenceFactor": 0)"));
}

std::string leaf(const std::string& content) {
  return with("KHR_materials_diffuse_transmission", "{" + content + "}");
}

TEST(GltfDiffuseTransmission, TransmitsItsShare) {
  const std::string behind = "[0, 1, 0, 0]";
  const std::vector<std::uint8_t> texel = {51, 102, 204, 128};
  const std::string share = R"("diffuseTransmissionFactor": 0.75,
                               "diffuseTransmissionColorFactor": [0.5, 1, 0.25])";
  const Vec3d color{0.5, 1, 0.25};
  const double passed = left_to_base(0.04, 0.5) / std::numbers::pi;
  expect_near(lit(leaf(share), texel, behind), color * (0.75 * passed), kCoupled);
  expect_near(lit(leaf(share)), kBase * (0.25 * passed) + kPlain * facets(0.5), kCoupled);
  EXPECT_EQ(lit(leaf(""), texel, behind), (Vec3d{0, 0, 0}));
  expect_near(lit(leaf(share + R"(, "diffuseTransmissionTexture": {"index": 0})"), texel, behind),
              color * (0.75 * 128 / 255.0 * passed), kCoupled);
  expect_near(
      lit(leaf(share + R"(, "diffuseTransmissionColorTexture": {"index": 0})"), texel, behind),
      Vec3d{0.5 * linear(51), linear(102), 0.25 * linear(204)} * (0.75 * passed), kCoupled);
}

}  // namespace
}  // namespace tessera::testing
