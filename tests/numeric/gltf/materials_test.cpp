/// glTF materials from the file to the pixel: a formula for each property and extension, and
/// another result without it.

#include <gtest/gtest.h>
#include <webp/encode.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "tests/numeric/gltf/material_probe.h"
#include "tests/support/render/gltf_probe.h"

namespace tessera::testing {
namespace {

using render::Vec2f;
using render::Vec3d;
using render::Vec4f;

TEST(GltfMaterial, DielectricCouplesDiffuseAndSpecular) {
  for (const double roughness : {0.3, 0.5, 1.0}) {
    expect_near(lit(with("", "", R"("baseColorFactor": [0.8, 0.4, 0.2, 1])", roughness)),
                dielectric(kBase, kPlain, roughness), kCoupled);
  }
}

TEST(GltfMaterial, MetalReflectsBaseColour) {
  // At this roughness multiple scattering between facets is below 1e-4 of the highlight.
  constexpr double kRoughness = 0.2;
  const auto seen_at = [&](double metallic) {
    return lit(with("", "", R"("baseColorFactor": [0.8, 0.4, 0.2, 1])", kRoughness, metallic));
  };
  const Vec3d metal = kBase * facets(kRoughness);
  expect_near(seen_at(1), metal, 1e-4);
  expect_near(seen_at(0.5), (dielectric(kBase, kPlain, kRoughness) + metal) * 0.5, 1e-4);
}

TEST(GltfMaterial, IorSetsSpecularReflectance) {
  const double f0 = 1.0 / 9;  // ((2 - 1) / (2 + 1))^2
  expect_near(lit(with("KHR_materials_ior", R"({"ior": 2})")), dielectric(kBase, {f0, f0, f0}, 0.5),
              kCoupled);
  expect_near(lit(with("KHR_materials_ior", R"({"ior": 1})")), dielectric(kBase, {}, 0.5),
              kCoupled);
  expect_near(lit(with("KHR_materials_ior", R"({"ior": 0})")), dielectric(kBase, {1, 1, 1}, 0.5),
              kCoupled);
}

TEST(GltfMaterial, SpecularExtensionScalesAndTints) {
  // F0 = min(0.04 colour, 1) factor; the base gets what the brightest channel leaves.
  expect_near(lit(with("KHR_materials_specular",
                       R"({"specularFactor": 0.5, "specularColorFactor": [2, 1, 0.5]})")),
              dielectric(kBase, {0.08, 0.04, 0.02}, 0.5, 0.5), kCoupled);
  expect_near(lit(with("KHR_materials_specular", R"({"specularColorFactor": [30, 0, 1]})")),
              dielectric(kBase, {1, 0, 0.04}, 0.5), 1e-2);  // little is left
  expect_near(lit(with("KHR_materials_specular", R"({"specularFactor": 0})")),
              kBase / std::numbers::pi, kRounding);
}

TEST(GltfMaterial, SpecularGlossinessReplacesMetallic) {
  const std::string material =
      with("KHR_materials_pbrSpecularGlossiness",
           R"({"diffuseFactor": [0.8, 0.4, 0.2, 1], "specularFactor": [0.1, 0.2, 0.3],
               "glossinessFactor": 0.5})",
           R"("baseColorFactor": [1, 1, 1, 1])", 1, 1);
  // c_diff = diffuse (1 - max specular); each channel's base gets what its own specular reflection
  // leaves.
  const Vec3d f0{0.1, 0.2, 0.3};
  Vec3d left;
  for (int k = 0; k < 3; ++k) left[k] = left_to_base(f0[k], 0.5);
  expect_near(lit(material), kBase * 0.7 * left / std::numbers::pi + f0 * facets(0.5), kCoupled);
}

/// A texture slot of a material: `slot` uses texture 0, `plain` the equal factors.
struct Slot {
  const char* name;
  std::string slot, plain;
};

TEST(GltfMaterial, TextureChannelsScaleFactors) {
  const std::vector<std::uint8_t> texel = {51, 102, 204, 128};  // 0.2, 0.4, 0.8; alpha 128 / 255
  const std::string code_alpha = std::to_string(128 / 255.0);
  const auto srgb = [](double factor) {
    return "[" + std::to_string(factor * linear(51)) + ", " + std::to_string(factor * linear(102)) +
           ", " + std::to_string(factor * linear(204));
  };
  const std::string half = R"("baseColorFactor": [0.5, 0.5, 0.5, 1], )";
  const std::string grey = R"("baseColorFactor": [0.5, 0.5, 0.5, 1])";
  const Slot slots[] = {
      {"baseColor", with("", "", half + R"("baseColorTexture": {"index": 0})"),
       with("", "", R"("baseColorFactor": )" + srgb(0.5) + ", 1]")},
      {"metallicRoughness",
       with("", "", grey + R"(, "metallicRoughnessTexture": {"index": 0})", 1, 0.5),
       with("", "", grey, 0.4, 0.4)},  // G times 1, B times 0.5
      {"emissive", R"({"emissiveFactor": [0.5, 0.5, 0.5], "emissiveTexture": {"index": 0}})",
       R"({"emissiveFactor": )" + srgb(0.5) + "]}"},
      {"specular", with("KHR_materials_specular", R"({"specularTexture": {"index": 0}})"),
       with("KHR_materials_specular", R"({"specularFactor": )" + code_alpha + "}")},
      {"specularColor",
       with("KHR_materials_specular",
            R"({"specularColorFactor": [9, 9, 9], "specularColorTexture": {"index": 0}})"),
       with("KHR_materials_specular", R"({"specularColorFactor": )" + srgb(9) + "]}")},
      {"transmission",
       with("KHR_materials_transmission",
            R"({"transmissionFactor": 0.5, "transmissionTexture": {"index": 0}})"),
       with("KHR_materials_transmission", R"({"transmissionFactor": 0.1})")},
      {"diffuse",
       with("KHR_materials_pbrSpecularGlossiness",
            R"({"diffuseFactor": [0.5, 0.5, 0.5, 1], "diffuseTexture": {"index": 0},
                           "specularFactor": [0, 0, 0], "glossinessFactor": 0})"),
       with("KHR_materials_pbrSpecularGlossiness",
            R"({"diffuseFactor": )" + srgb(0.5) +
                R"(, 1], "specularFactor": [0, 0, 0], "glossinessFactor": 0})")},
      {"specularGlossiness",
       with("KHR_materials_pbrSpecularGlossiness",
            R"({"specularFactor": [0.5, 0.5, 0.5], "specularGlossinessTexture": {"index": 0}})"),
       with(
           "KHR_materials_pbrSpecularGlossiness",
           R"({"specularFactor": )" + srgb(0.5) + R"(], "glossinessFactor": )" + code_alpha + "}")},
  };
  for (const Slot& slot : slots) {
    SCOPED_TRACE(slot.name);
    const Vec3d plain = lit(slot.plain);
    expect_near(lit(slot.slot, texel), plain, 1e-4);  // six decimals of the factors as text
    const Vec3d white = lit(slot.slot, {255, 255, 255, 255});
    EXPECT_GT(std::fabs(white.x - plain.x), 1e-3 * plain.x) << "the texture changes the result";
  }
}

TEST(GltfMaterial, OcclusionIsIgnored) {
  const std::string core = with("", "");
  const std::string occluded =
      core.substr(0, core.size() - 1) + R"(, "occlusionTexture": {"index": 0}})";
  EXPECT_EQ(lit(occluded), lit(core));
}

TEST(GltfMaterial, EmissiveStrengthScalesRadiance) {
  const std::string black = R"({"emissiveFactor": [1, 0.5, 0.25], "pbrMetallicRoughness":
      {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0}, "extensions": {
      "KHR_materials_specular": {"specularFactor": 0})";
  EXPECT_EQ(lit(black + R"(, "KHR_materials_emissive_strength": {"emissiveStrength": 40}}})"),
            (Vec3d{40, 20, 10}));
  EXPECT_EQ(lit(black + "}}"), (Vec3d{1, 0.5, 0.25}));
}

TEST(GltfMaterial, UnlitShowsBaseColour) {
  expect_near(lit(with("KHR_materials_unlit", "{}")), kBase, 1e-7);
}

TEST(GltfMaterial, VertexColourScalesBaseColour) {
  const auto file = probe_of(kX, kY);
  const int material = file->add_material(with("KHR_materials_unlit", "{}"));
  file->add_node_with_mesh(file->add_mesh(unit_quad(material)));
  const int colors = file->add_vec4(std::vector<Vec4f>(4, Vec4f{0.5f, 0.25f, 1, 1}));
  file->set("/meshes/0/primitives/0/attributes/COLOR_0", std::to_string(colors));
  expect_near(seen(*file, probe_settings()), {0.4, 0.1, 0.2}, 1e-7);
}

/// A square of `material` before a background of radiance (1, 2, 3).
Vec3d before_a_background(const std::string& material, int spp = 16) {
  const auto file = probe_of(kX, kY);
  file->add_node_with_mesh(file->add_mesh(unit_quad(file->add_material(material))));
  contract::RenderSettings settings = probe_settings();
  settings.background = contract::Background::color;
  settings.background_color = {1, 2, 3};
  settings.spp = spp;
  return seen(*file, settings);
}

TEST(GltfMaterial, AlphaModeSetsCoverage) {
  const auto material = [](const char* alpha, const char* mode) {
    return std::string(R"({"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, )") + alpha +
           R"(]}, "extensions": {"KHR_materials_unlit": {}}, )" + mode + "}";
  };
  const std::string mask = R"("alphaMode": "MASK", "alphaCutoff": 0.25)";
  EXPECT_EQ(before_a_background(material("0.2", mask.c_str())), (Vec3d{1, 2, 3}));
  EXPECT_EQ(before_a_background(material("0.25", mask.c_str())), (Vec3d{0, 0, 0}));
  EXPECT_EQ(before_a_background(material("0.2", R"("alphaMode": "OPAQUE")")), (Vec3d{0, 0, 0}));
  // A fraction of 0.75 of 4,096 samples: four standard errors are 0.027.
  const Vec3d blend = before_a_background(material("0.25", R"("alphaMode": "BLEND")"), 4096);
  EXPECT_NEAR(blend.x, 0.75, 0.027);
  EXPECT_NEAR(blend.z, 3 * blend.x, 1e-5);
}

/// A square of `material` 1 m before a lamp of radiance (1, 2, 3), with nothing else to see.
Vec3d before_a_lamp(const std::string& material, int spp) {
  const auto file = probe_of(kX, kY);
  file->add_node_with_mesh(file->add_mesh(unit_quad(file->add_material(material))));
  const int lamp = file->add_material(
      R"({"emissiveFactor": [0.25, 0.5, 0.75], "pbrMetallicRoughness":
          {"baseColorFactor": [0, 0, 0, 1]}, "extensions": {
          "KHR_materials_specular": {"specularFactor": 0},
          "KHR_materials_emissive_strength": {"emissiveStrength": 4}}})");
  file->add_node_with_mesh(file->add_mesh(unit_quad(lamp)), R"({"translation": [0, 0, -1]})");
  contract::RenderSettings settings = probe_settings();
  settings.spp = spp;
  return seen(*file, settings);
}

TEST(GltfMaterial, ThinTransmissionTintsOnce) {
  const std::string tint = R"("baseColorFactor": [0.5, 0.25, 1, 1])";
  const Vec3d tinted{0.5, 2 * 0.25, 3 * 1};
  const std::string sheet =
      with("KHR_materials_transmission", R"({"transmissionFactor": 1})", tint, 0);
  const std::string matched =
      sheet.substr(0, sheet.size() - 2) + R"(, "KHR_materials_ior": {"ior": 1}}})";
  expect_near(before_a_lamp(matched, 16), tinted, 1e-6);
  // An eighth of the samples is reflected into the dark: a standard deviation of 0.37 of the mean,
  // four standard errors of 4,096 samples.
  expect_near(before_a_lamp(sheet, 4096), tinted * 0.96, 4 * 0.37 / 64);
  EXPECT_EQ(before_a_lamp(with("", "", tint, 0), 16), (Vec3d{0, 0, 0}));
}

/// Fraction of light along the normal that GGX facets reflect upwards at the first hit: D cos G1
/// over the half vectors. Source: Heitz 2014, eq. 72 (Lambda) and 99 (correlated G).
double kept_by_facets(double roughness) {
  const double a2 = std::pow(roughness, 4);
  constexpr int kSteps = 100'000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double half = std::numbers::pi / 4 * (i + 0.5) / kSteps, out = 2 * half;
    const double c = std::cos(half), t = std::tan(out);
    const double d = a2 / (std::numbers::pi * std::pow(c * c * (a2 - 1) + 1, 2));
    const double lambda = (std::sqrt(1 + a2 * t * t) - 1) / 2;
    sum += d * c / (1 + lambda) * 2 * std::numbers::pi * std::sin(half) *
           (std::numbers::pi / 4 / kSteps);
  }
  return sum;
}

TEST(GltfMaterial, RoughThinTransmissionSpreadsLight) {
  // The sun is behind the sheet, along the view: a smooth sheet shows none of it (no path hits a
  // direction), a rough one its transmitted lobe: base D V, with the compensation of multiple
  // scattering.
  const auto backlit = [](double roughness) {
    const auto file = probe_of(kX, kY);
    add_sun(*file, 1);
    file->set("/nodes/1/rotation", "[0, 1, 0, 0]");  // light along +z
    const std::string core = with("KHR_materials_transmission", R"({"transmissionFactor": 1})",
                                  R"("baseColorFactor": [0.8, 0.4, 0.2, 1])", roughness);
    const std::string material =
        core.substr(0, core.size() - 2) + R"(, "KHR_materials_ior": {"ior": 1}}})";
    file->add_node_with_mesh(file->add_mesh(unit_quad(file->add_material(material))));
    return seen(*file, probe_settings());
  };
  for (const double roughness : {0.2, 0.5, 0.9}) {  // table interpolation: 1e-3
    expect_near(backlit(roughness), kBase * (facets(roughness) / kept_by_facets(roughness)),
                1.5e-3);
  }
  EXPECT_EQ(backlit(0), (Vec3d{0, 0, 0}));
}

/// Radiance straight through a box 2 m deep before a background of radiance 1.
Vec3d through_a_box(const std::string& extensions) {
  const auto file = probe_of(kX, kY);
  const int material = file->add_material(
      R"({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 1], "metallicFactor": 0,
          "roughnessFactor": 0}, "extensions": {"KHR_materials_ior": {"ior": 1}, )" +
      extensions + "}}");
  file->add_node_with_mesh(file->add_mesh(box_around_unit_square(material)));
  contract::RenderSettings settings = probe_settings();
  settings.max_depth = 4;
  settings.background = contract::Background::color;
  settings.background_color = {1, 1, 1};
  return seen(*file, settings);
}

TEST(GltfMaterial, VolumeAbsorbsAlongPath) {
  const std::string clear = R"("KHR_materials_transmission": {"transmissionFactor": 1})";
  const std::string volume = R"(, "KHR_materials_volume": {"thicknessFactor": 1,
      "attenuationDistance": 0.8, "attenuationColor": [1, 0.5, 0.1]})";
  const double distance = 2 / 0.8;
  expect_near(through_a_box(clear + volume),
              {0.25, std::pow(0.5, distance), std::pow(0.1, distance)}, 1e-5);
  expect_near(through_a_box(clear), {0.25, 1, 1}, 1e-6);
}

TEST(GltfMaterial, DoubleSidedEmitsFromBack) {
  const auto back = [](const char* sided, bool cull) {
    const auto file = probe_of(kX, kY);
    const int material = file->add_material(
        std::string(R"({"emissiveFactor": [1, 0.5, 0.25], "doubleSided": )") + sided + "}");
    TriangleMesh quad = unit_quad(material);
    quad.indices = {0, 2, 1, 0, 3, 2};
    file->add_node_with_mesh(file->add_mesh(quad));
    contract::RenderSettings settings = probe_settings();
    settings.background = contract::Background::color;
    settings.background_color = {0, 0, 8};
    settings.cull_backfaces = cull;
    return seen(*file, settings);
  };
  EXPECT_EQ(back("true", true).x, 1);
  EXPECT_EQ(back("false", false).x, 0);
  EXPECT_EQ(back("false", true), (Vec3d{0, 0, 8}));
}

TEST(GltfMaterial, VariantReplacesMaterial) {
  const auto file = probe_of(kX, kY);
  file->use_extension("KHR_materials_variants");
  file->set("/extensions/KHR_materials_variants/variants",
            R"([{"name": "day"}, {"name": "dusk"}])");
  file->add_material(with("KHR_materials_unlit", "{}"));
  file->add_material(with("KHR_materials_unlit", "{}", R"("baseColorFactor": [0, 0, 1, 1])"));
  file->add_node_with_mesh(file->add_mesh(unit_quad(0)));
  file->set("/meshes/0/primitives/0/extensions/KHR_materials_variants/mappings",
            R"([{"material": 1, "variants": [1]}])");
  contract::RenderSettings settings = probe_settings();
  expect_near(seen(*file, settings), kBase, 1e-7);
  settings.variant = "dusk";
  EXPECT_EQ(seen(*file, settings), (Vec3d{0, 0, 1}));
}

/// An unlit square with a texture of 4 x 4 texels, nearest filtering; red is 16 row + column.
/// Coordinate set 0 is (0.1, 0.1) everywhere, set 1 is (0.6, 0.9).
int texel_read(const std::string& texture_info) {
  const auto file = probe_of(kX, kY);
  std::vector<std::uint8_t> codes;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      codes.insert(codes.end(), {static_cast<std::uint8_t>(16 * row + column), 0, 0, 255});
    }
  }
  file->add_texture(file->add_image(png(4, 4, codes), "image/png"), R"({"magFilter": 9728})");
  const int material = file->add_material(
      R"({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0)" + texture_info + "}}");
  TriangleMesh quad = unit_quad(material);
  quad.uv.assign(4, Vec2f{0.1f, 0.1f});
  file->add_node_with_mesh(file->add_mesh(quad));
  const int second = file->add_vec2(std::vector<Vec2f>(4, Vec2f{0.6f, 0.9f}));
  file->set("/meshes/0/primitives/0/attributes/TEXCOORD_1", std::to_string(second));
  const double red = seen(*file, probe_settings()).x;
  for (int code = 0; code < 64; ++code) {
    if (std::fabs(red - linear(code)) < 1e-6) return code;
  }
  ADD_FAILURE() << "no texel has " << red;
  return -1;
}

/// The texel at uv = (u, v) moved by offset, rotation (anticlockwise where v runs up) and scale.
/// Source: KHR_texture_transform, as three matrices written out.
int texel_at(double u, double v, const Vec3d& offset = {}, double rotation = 0,
             const Vec3d& scale = {1, 1, 1}) {
  const double x = u * scale.x, y = v * scale.y;
  const double c = std::cos(rotation), s = std::sin(rotation);
  const double moved_u = c * x + s * y + offset.x, moved_v = -s * x + c * y + offset.y;
  const auto cell = [](double t) { return static_cast<int>(std::floor((t - std::floor(t)) * 4)); };
  return 16 * cell(moved_v) + cell(moved_u);
}

TEST(GltfTextureTransform, MovesRotatesAndScalesUv) {
  const auto moved = [](const std::string& content) {
    return texel_read(R"(, "extensions": {"KHR_texture_transform": {)" + content + "}}");
  };
  EXPECT_EQ(texel_read(""), texel_at(0.1, 0.1));
  EXPECT_EQ(moved(R"("offset": [0.5, 0.25])"), texel_at(0.1, 0.1, {0.5, 0.25, 0}));
  EXPECT_EQ(moved(R"("scale": [6, 3])"), texel_at(0.1, 0.1, {}, 0, {6, 3, 1}));
  EXPECT_EQ(moved(R"("rotation": 1, "scale": [6, 3])"), texel_at(0.1, 0.1, {}, 1, {6, 3, 1}));
  EXPECT_EQ(moved(R"("offset": [0.3, 0.4], "rotation": -2, "scale": [9, 7])"),
            texel_at(0.1, 0.1, {0.3, 0.4, 0}, -2, {9, 7, 1}));
}

TEST(GltfTextureTransform, TexCoordOverridesTexture) {
  const auto read = [](const std::string& outside, const std::string& inside) {
    return texel_read(outside + R"(, "extensions": {"KHR_texture_transform":
                                    {"offset": [0.25, 0])" +
                      inside + "}}");
  };
  const int of_set_0 = texel_at(0.1, 0.1, {0.25, 0, 0}),
            of_set_1 = texel_at(0.6, 0.9, {0.25, 0, 0});
  ASSERT_NE(of_set_0, of_set_1);
  EXPECT_EQ(texel_read(R"(, "texCoord": 1)"), texel_at(0.6, 0.9));
  EXPECT_EQ(read("", ""), of_set_0);
  EXPECT_EQ(read(R"(, "texCoord": 1)", ""), of_set_1);
  EXPECT_EQ(read("", R"(, "texCoord": 1)"), of_set_1);
  EXPECT_EQ(read(R"(, "texCoord": 1)", R"(, "texCoord": 0)"), of_set_0);
  EXPECT_EQ(read(R"(, "texCoord": 5)", R"(, "texCoord": 1)"), of_set_1) << "set 5 is not used";
}

/// A lossless WebP of one colour.
std::vector<std::byte> webp(std::uint8_t r, std::uint8_t g, std::uint8_t b) {
  const std::array<std::uint8_t, 3> code = {r, g, b};
  std::uint8_t* written = nullptr;
  const std::size_t size = WebPEncodeLosslessRGB(code.data(), 1, 1, 3, &written);
  const auto view = std::as_bytes(std::span(written, size));
  std::vector<std::byte> bytes(view.begin(), view.end());
  WebPFree(written);
  return bytes;
}

TEST(GltfTexture, WebpIsPreferredToFallback) {
  const auto colour = [](bool webp_named) {
    const auto file = probe_of(kX, kY);
    const int plain = file->add_image(png(1, 1, {255, 0, 0, 255}), "image/png");
    const int better = file->add_image(webp(0, 255, 255), "image/webp");
    file->add_texture(plain);
    if (webp_named) {
      file->use_extension("EXT_texture_webp");
      file->set("/textures/0/extensions/EXT_texture_webp/source", std::to_string(better));
    }
    const int material =
        file->add_material(R"({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}})");
    file->add_node_with_mesh(file->add_mesh(unit_quad(material)));
    return seen(*file, probe_settings());
  };
  EXPECT_EQ(colour(false), (Vec3d{1, 0, 0}));
  EXPECT_EQ(colour(true), (Vec3d{0, 1, 1}));
}

/// A white Lambert square with a one-texel normal map, under a sun of pi lux along -z: the cosine
/// of the shading normal. Tangents: given (along `tangent`), or made from the coordinates.
double cosine_under(const std::vector<std::uint8_t>& texel, const std::string& scale,
                    const Vec4f* tangent) {
  const auto file = probe_of(kX, kY);
  add_sun(*file, std::numbers::pi);
  file->add_texture(file->add_image(png(1, 1, texel), ""));
  const int material = file->add_material(
      R"({"pbrMetallicRoughness": {"metallicFactor": 0}, "normalTexture": {"index": 0)" + scale +
      R"(}, "extensions": {"KHR_materials_specular": {"specularFactor": 0}}})");
  TriangleMesh quad = unit_quad(material);
  quad.normals.assign(4, {0, 0, 1});
  file->add_node_with_mesh(file->add_mesh(quad));
  if (tangent != nullptr) {
    const int tangents = file->add_vec4(std::vector<Vec4f>(4, *tangent));
    file->set("/meshes/0/primitives/0/attributes/TANGENT", std::to_string(tangents));
  }
  file->set("/nodes/1/rotation", "[0, 0.1305261922, 0, 0.9914448614]");  // 15 degrees towards -x
  return seen(*file, probe_settings()).x;
}

TEST(GltfMaterial, NormalMapTiltsAlongTangents) {
  const std::vector<std::uint8_t> texel = {178, 102, 230, 255};
  const auto expected = [&](double scale, const Vec3d& tangent, const Vec3d& bitangent) {
    const double x = (2 * texel[0] / 255.0 - 1) * scale, y = (2 * texel[1] / 255.0 - 1) * scale;
    const double z = 2 * texel[2] / 255.0 - 1;
    const Vec3d n = normalize(tangent * x + bitangent * y + Vec3d{0, 0, 1} * z);
    const double angle =
        std::numbers::pi / 12;  // -z turned by 15 degrees about +y points to (-sin, 0, -cos)
    return dot(n, Vec3d{std::sin(angle), 0, std::cos(angle)});
  };
  const Vec3d right{1, 0, 0}, up{0, 1, 0};
  // Generated from u = x, v = y: green points up in the image, against v.
  EXPECT_NEAR(cosine_under(texel, "", nullptr), expected(1, right, -up), 1e-6);
  EXPECT_NEAR(cosine_under(texel, R"(, "scale": 0.25)", nullptr), expected(0.25, right, -up), 1e-6);
  const Vec4f along_y{0, 1, 0, 1}, mirrored{0, 1, 0, -1};
  EXPECT_NEAR(cosine_under(texel, "", &along_y), expected(1, up, -right), 1e-6);
  EXPECT_NEAR(cosine_under(texel, "", &mirrored), expected(1, up, right), 1e-6);
}

}  // namespace
}  // namespace tessera::testing
