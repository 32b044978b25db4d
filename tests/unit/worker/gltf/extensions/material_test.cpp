#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"

namespace tessera::render {
namespace {

using testing::GltfBuilder;
using testing::load_and_pose;
using testing::unit_quad;

constexpr const char* kPng =
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8/5+"
    "hHgAHggJ/PchI7wAAAABJRU5ErkJggg==";

/// A quad with the given material; it may use textures 0 and 1.
absl::StatusOr<Scene> scene_with(const std::string& material,
                                 const contract::RenderSettings& settings = {}) {
  GltfBuilder b;
  b.add("images", std::string(R"({"uri": ")") + kPng + R"("})");
  b.add_texture(0, R"({"wrapS": 33071, "wrapT": 33648, "magFilter": 9728})");
  b.add_texture(0);
  b.add_mesh(unit_quad(b.add_material(material)));
  b.add_node_with_mesh(0);
  return load_and_pose(b, settings);
}

Material material_of(const std::string& text) {
  const auto scene = scene_with(text);
  EXPECT_TRUE(scene.ok()) << scene.status();
  return scene.ok() ? scene->materials[0] : Material();
}

TEST(Materials, DefaultsMatchGltf) {
  const Material m = material_of("{}");
  EXPECT_EQ(m.base_color, (Vec4f{1, 1, 1, 1}));
  EXPECT_EQ(m.metallic, 1);
  EXPECT_EQ(m.roughness, 1);
  EXPECT_EQ(m.emission, (Vec3f{0, 0, 0}));
  EXPECT_EQ(m.alpha_mode, AlphaMode::opaque);
  EXPECT_EQ(m.alpha_cutoff, 0.5f);
  EXPECT_EQ(m.ior, 1.5f);
  EXPECT_EQ(m.specular, 1);
  EXPECT_EQ(m.transmission, 0);
  EXPECT_FALSE(m.double_sided || m.unlit || m.has_volume || m.specular_glossiness);
}

TEST(Materials, CorePropertiesAreRead) {
  const Material m = material_of(R"({"name": "paint", "doubleSided": true, "alphaMode": "MASK",
    "alphaCutoff": 0.25, "emissiveFactor": [0.5, 0, 1],
    "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5,
      "roughnessFactor": 0.75, "baseColorTexture": {"index": 0},
      "metallicRoughnessTexture": {"index": 1}},
    "normalTexture": {"index": 1, "scale": 2}, "emissiveTexture": {"index": 1}})");
  EXPECT_EQ(m.name, "paint");
  EXPECT_EQ(m.base_color, (Vec4f{0.1f, 0.2f, 0.3f, 0.4f}));
  EXPECT_EQ(m.metallic, 0.5f);
  EXPECT_EQ(m.roughness, 0.75f);
  EXPECT_EQ(m.emission, (Vec3f{0.5f, 0, 1}));
  EXPECT_EQ(m.alpha_mode, AlphaMode::mask);
  EXPECT_EQ(m.alpha_cutoff, 0.25f);
  EXPECT_TRUE(m.double_sided);
  EXPECT_EQ(m.base_color_texture.texture, 0);
  EXPECT_TRUE(m.base_color_texture.srgb);
  EXPECT_FALSE(m.metallic_roughness_texture.srgb);
  EXPECT_FALSE(m.normal_texture.srgb);
  EXPECT_EQ(m.normal_scale, 2);
  EXPECT_TRUE(m.emissive_texture.srgb);
}

TEST(Materials, EveryExtensionIsRead) {
  const Material m = material_of(R"({"emissiveFactor": [1, 0.5, 0], "extensions": {
    "KHR_materials_emissive_strength": {"emissiveStrength": 40},
    "KHR_materials_ior": {"ior": 1.33},
    "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [2, 1, 0],
      "specularTexture": {"index": 0}, "specularColorTexture": {"index": 1}},
    "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": {"index": 0}},
    "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 3,
      "attenuationColor": [0.5, 0.25, 1]},
    "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 0},
      "clearcoatRoughnessFactor": 0.25, "clearcoatRoughnessTexture": {"index": 1},
      "clearcoatNormalTexture": {"index": 1, "scale": 3}},
    "KHR_materials_anisotropy": {"anisotropyStrength": 0.5, "anisotropyRotation": 2,
      "anisotropyTexture": {"index": 0}},
    "KHR_materials_sheen": {"sheenColorFactor": [0.5, 0.25, 1], "sheenColorTexture": {"index": 0},
      "sheenRoughnessFactor": 0.75, "sheenRoughnessTexture": {"index": 1}},
    "KHR_materials_dispersion": {"dispersion": 0.5},
    "KHR_materials_iridescence": {"iridescenceFactor": 0.5, "iridescenceTexture": {"index": 0},
      "iridescenceIor": 1.5, "iridescenceThicknessMinimum": 50, "iridescenceThicknessMaximum": 900,
      "iridescenceThicknessTexture": {"index": 1}},
    "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5,
      "diffuseTransmissionTexture": {"index": 0}, "diffuseTransmissionColorFactor": [1, 0.5, 0],
      "diffuseTransmissionColorTexture": {"index": 1}}}})");
  EXPECT_EQ(m.emission, (Vec3f{40, 20, 0}));
  EXPECT_EQ(m.ior, 1.33f);
  EXPECT_EQ(m.specular, 0.5f);
  EXPECT_EQ(m.specular_color, (Vec3f{2, 1, 0}));
  EXPECT_FALSE(m.specular_texture.srgb);
  EXPECT_TRUE(m.specular_color_texture.srgb);
  EXPECT_EQ(m.transmission, 0.75f);
  EXPECT_EQ(m.transmission_texture.texture, 0);
  EXPECT_TRUE(m.has_volume);
  EXPECT_EQ(m.attenuation_distance, 3);
  EXPECT_EQ(m.attenuation_color, (Vec3f{0.5f, 0.25f, 1}));
  EXPECT_EQ(m.clearcoat.factor, 0.5f);
  EXPECT_EQ(m.clearcoat.texture.texture, 0);
  EXPECT_FALSE(m.clearcoat.texture.srgb);
  EXPECT_EQ(m.clearcoat.roughness, 0.25f);
  EXPECT_EQ(m.clearcoat.roughness_texture.texture, 1);
  EXPECT_FALSE(m.clearcoat.roughness_texture.srgb);
  EXPECT_EQ(m.clearcoat.normal_texture.texture, 1);
  EXPECT_EQ(m.clearcoat.normal_scale, 3);
  EXPECT_EQ(m.anisotropy.strength, 0.5f);
  EXPECT_EQ(m.anisotropy.rotation, 2);
  EXPECT_FALSE(m.anisotropy.texture.srgb);
  EXPECT_EQ(m.sheen.color, (Vec3f{0.5f, 0.25f, 1}));
  EXPECT_TRUE(m.sheen.color_texture.srgb);
  EXPECT_EQ(m.sheen.roughness, 0.75f);
  EXPECT_FALSE(m.sheen.roughness_texture.srgb);
  EXPECT_EQ(m.dispersion, 0.5f);
  EXPECT_EQ(m.iridescence.factor, 0.5f);
  EXPECT_EQ(m.iridescence.ior, 1.5f);
  EXPECT_EQ(m.iridescence.thickness_minimum, 50);
  EXPECT_EQ(m.iridescence.thickness_maximum, 900);
  EXPECT_EQ(m.iridescence.thickness_texture.texture, 1);
  EXPECT_EQ(m.diffuse_transmission.factor, 0.5f);
  EXPECT_EQ(m.diffuse_transmission.color, (Vec3f{1, 0.5f, 0}));
  EXPECT_TRUE(m.diffuse_transmission.color_texture.srgb);
  EXPECT_FALSE(m.diffuse_transmission.texture.srgb);
}

TEST(Materials, ExcludedLayersAreIgnoredWithNote) {
  GltfBuilder b;
  b.use_extension("KHR_materials_unlit");
  b.use_extension("KHR_materials_clearcoat");
  b.add_node_with_mesh(b.add_mesh(unit_quad(b.add_material(
      R"({"extensions": {"KHR_materials_unlit": {}, "KHR_materials_clearcoat":
          {"clearcoatFactor": 1}}})"))));
  testing::MemoryReader reader;
  reader.put("scene.gltf", b.gltf());
  const auto file = load_scene_file("scene.gltf", {}, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  ASSERT_EQ((*file)->problems().size(), 1u);
  EXPECT_EQ((*file)->problems()[0].element, "materials[0].extensions.KHR_materials_clearcoat");
  EXPECT_EQ((*file)->pose({}, 0)->materials[0].clearcoat.factor, 0);
}

TEST(Materials, ThinUnlitAndIorZeroAreRead) {
  EXPECT_FALSE(material_of(R"({"extensions": {"KHR_materials_volume": {}}})").has_volume);
  EXPECT_TRUE(material_of(R"({"extensions": {"KHR_materials_unlit": {}}})").unlit);
  EXPECT_EQ(material_of(R"({"extensions": {"KHR_materials_ior": {"ior": 0}}})").ior, 0);
}

TEST(Materials, SpecularGlossinessReplacesMetallic) {
  const Material m = material_of(R"({"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]},
    "extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.25, 0.5, 0.75, 0.5],
      "specularFactor": [0.1, 0.2, 0.3], "glossinessFactor": 0.4, "diffuseTexture": {"index": 0},
      "specularGlossinessTexture": {"index": 1}}}})");
  EXPECT_TRUE(m.specular_glossiness);
  EXPECT_EQ(m.base_color, (Vec4f{0.25f, 0.5f, 0.75f, 0.5f}));
  EXPECT_EQ(m.specular_f0, (Vec3f{0.1f, 0.2f, 0.3f}));
  EXPECT_EQ(m.glossiness, 0.4f);
  EXPECT_TRUE(m.base_color_texture.srgb);
  EXPECT_TRUE(m.specular_glossiness_texture.srgb);
}

TEST(Samplers, DefaultToRepeatAndLinear) {
  const auto scene = scene_with(R"({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})");
  ASSERT_TRUE(scene.ok());
  EXPECT_EQ(scene->textures[0].wrap_u, Wrap::clamp);
  EXPECT_EQ(scene->textures[0].wrap_v, Wrap::mirror);
  EXPECT_TRUE(scene->textures[0].nearest);
  EXPECT_EQ(scene->textures[1].wrap_u, Wrap::repeat);
  EXPECT_FALSE(scene->textures[1].nearest);
}

TEST(TextureTransform, ScalesThenRotatesThenMoves) {
  const Material m = material_of(R"({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0,
    "extensions": {"KHR_texture_transform": {"offset": [0.25, 0.5], "rotation": 0.5,
      "scale": [2, 3], "texCoord": 1}}}}})");
  const TextureRef& ref = m.base_color_texture;
  ASSERT_TRUE(ref.has_transform);
  EXPECT_EQ(ref.uv_set, 1);
  // v runs down in glTF: a positive angle turns (u, v) towards (u, -v) there.
  const double c = std::cos(0.5), s = std::sin(0.5);
  const double want[6] = {2 * c, 3 * s, 0.25, -2 * s, 3 * c, 0.5};
  for (std::size_t k = 0; k < 6; ++k) EXPECT_NEAR(ref.uv_matrix[k], want[k], 1e-6) << k;
}

TEST(TextureTransform, IsReadForExtensionTextures) {
  const Material m = material_of(R"({"extensions": {"KHR_materials_transmission":
    {"transmissionTexture": {"index": 0,
      "extensions": {"KHR_texture_transform": {"offset": [1, 2]}}}}}})");
  ASSERT_TRUE(m.transmission_texture.has_transform);
  EXPECT_EQ(m.transmission_texture.uv_matrix, (std::array<float, 6>{1, 0, 1, 0, 1, 2}));
}

TEST(Textures, UnusedMaterialsAreNotDecoded) {
  GltfBuilder b;
  b.add("images", R"({"uri": "data:image/png;base64,AAAA"})");  // cannot be decoded
  b.add("images", std::string(R"({"uri": ")") + kPng + R"("})");
  b.add_texture(0);
  b.add_texture(1);
  b.add_texture(1);
  b.add_material(R"({"emissiveTexture": {"index": 0}})");
  const int used = b.add_material(R"({"emissiveTexture": {"index": 1},
                                      "normalTexture": {"index": 2}})");
  b.add_mesh(unit_quad(used));
  b.add_node_with_mesh(0);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->images.size(), 1u) << "one image, decoded once for both textures";
  EXPECT_EQ(scene->textures[0].image, kNone);
  EXPECT_EQ(scene->textures[1].image, 0);
  EXPECT_EQ(scene->textures[2].image, 0);
  EXPECT_FALSE(scene->materials[0].emissive_texture);
}

TEST(Textures, UniformImageBecomesOneTexel) {
  const auto image_of = [](const std::string& base64) {
    GltfBuilder b;
    b.add("images", R"({"uri": "data:image/png;base64,)" + base64 + R"("})");
    b.add_texture(0);
    b.add_mesh(unit_quad(
        b.add_material(R"({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})")));
    b.add_node_with_mesh(0);
    const auto scene = load_and_pose(b);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene->images.at(0);
  };
  // 2 x 2 texels of 10, 20, 30; in the second, the last is 10, 20, 31.
  const Image even = image_of(
      "iVBORw0KGgoAAAANSUhEUgAAAAIAAAACCAIAAAD91JpzAAAAEElEQVR42mPgEpEDIgYIBQAGTgDx0GKdDgAAAABJRU5E"
      "rkJggg==");
  EXPECT_EQ(even.width, 1);
  EXPECT_EQ(even.height, 1);
  EXPECT_EQ(even.u8, (SharedArray<std::uint8_t>{10, 20, 30}));
  const Image uneven = image_of(
      "iVBORw0KGgoAAAANSUhEUgAAAAIAAAACCAIAAAD91JpzAAAAEUlEQVR42mPgEpEDIgYwJQ8ABk8A8qmbb9UAAAAASUVO"
      "RK5CYII=");
  EXPECT_EQ(uneven.width, 2);
  EXPECT_EQ(uneven.u8.size(), 12u);
}

TEST(Textures, OnlyUsedUvSetsAreRead) {
  GltfBuilder b;
  b.add("images", std::string(R"({"uri": ")") + kPng + R"("})");
  b.add_texture(0);
  const int m = b.add_material(R"({"emissiveTexture": {"index": 0, "texCoord": 1}})");
  b.add_mesh(unit_quad(m));
  b.set("/meshes/0/primitives/0/attributes/TEXCOORD_1",
        std::to_string(b.add_vec2({{0.5f, 0}, {1, 0}, {1, 1}, {0, 1}})));
  b.add_node_with_mesh(0);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok());
  const Primitive& p = scene->meshes[0].primitives[0];
  EXPECT_TRUE(p.uv[0].empty());
  ASSERT_EQ(p.uv[1].size(), 4u);
  EXPECT_EQ(p.uv[1][0], (Vec2f{0.5f, 0}));
  EXPECT_TRUE(p.tangents.empty()) << "no normal map, no tangents";
}

TEST(Variants, ReplaceMappedMaterials) {
  GltfBuilder b;
  b.use_extension("KHR_materials_variants");
  b.set("/extensions/KHR_materials_variants/variants", R"([{"name": "red"}, {"name": "blue"}])");
  b.add_material("{}");
  b.add_material("{}");
  b.add_mesh(unit_quad(0));
  b.set("/meshes/0/primitives/0/extensions/KHR_materials_variants/mappings",
        R"([{"material": 1, "variants": [1]}])");
  b.add_node_with_mesh(0);
  contract::RenderSettings settings;
  const auto material = [&](const char* variant) {
    settings.variant = variant;
    return load_and_pose(b, settings)->meshes[0].primitives[0].material;
  };
  EXPECT_EQ(material(""), 0);
  EXPECT_EQ(material("red"), 0);
  EXPECT_EQ(material("blue"), 1);
  settings.variant = "green";
  EXPECT_EQ(load_and_pose(b, settings).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(Materials, DefaultMaterialIsAppended) {
  GltfBuilder b;
  b.add_material("{}");
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  const auto scene = load_and_pose(b);
  ASSERT_EQ(scene->materials.size(), 2u);
  EXPECT_EQ(scene->meshes[0].primitives[0].material, 1);
}

TEST(Extensions, UnknownRequiredIsRejected) {
  for (const char* name : {"KHR_gaussian_splatting", "KHR_materials_magic", "VENDOR_magic"}) {
    testing::MemoryReader reader;
    GltfBuilder used, required;
    used.use_extension(name);
    required.use_extension(name, true);
    const auto refused = load_and_pose(required);
    EXPECT_EQ(refused.status().code(), absl::StatusCode::kUnimplemented);
    EXPECT_NE(std::string(refused.status().message()).find(name), std::string::npos);
    reader.put("scene.gltf", used.gltf());
    const auto file = load_scene_file("scene.gltf", {}, reader);
    ASSERT_TRUE(file.ok());
    ASSERT_EQ((*file)->problems().size(), 1u);
    EXPECT_EQ((*file)->problems()[0].severity, Problem::Severity::warning);
    EXPECT_EQ((*file)->problems()[0].element, "extensionsUsed");
    EXPECT_TRUE((*file)->problems()[0].message.starts_with(name));
  }
}

TEST(Textures, BasisNeedsFallback) {
  const auto load = [](bool fallback) {
    GltfBuilder b;
    b.use_extension("KHR_texture_basisu", !fallback);
    b.add("images", R"({"uri": "t.ktx2"})");
    b.add("images", std::string(R"({"uri": ")") + kPng + R"("})");
    b.add("textures", std::string(R"({"extensions": {"KHR_texture_basisu": {"source": 0}})") +
                          (fallback ? R"(, "source": 1})" : "}"));
    b.add_mesh(unit_quad(b.add_material(R"({"emissiveTexture": {"index": 0}})")));
    b.add_node_with_mesh(0);
    return load_and_pose(b);
  };
  EXPECT_TRUE(load(true).ok()) << load(true).status();
  const auto refused = load(false);
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kUnimplemented);
  EXPECT_NE(std::string(refused.status().message()).find("textures[0]: KHR_texture_basisu"),
            std::string::npos);
}

}  // namespace
}  // namespace tessera::render
