/// KHR_animation_pointer: animated properties of cameras, materials, lights, textures and nodes.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"

namespace tessera::testing {
namespace {

using render::Scene;

/// A file with a camera, a light, a material with a procedural texture, and an animation of the
/// number at `pointer` from `from` at 0 s to `to` at 2 s.
std::unique_ptr<GltfBuilder> animated(const std::string& pointer, const std::vector<float>& from,
                                      const std::vector<float>& to,
                                      const std::string& interpolation = "LINEAR") {
  auto file = std::make_unique<GltfBuilder>();
  for (const char* name : {"KHR_animation_pointer", "KHR_lights_punctual", "TESSERA_camera",
                           "TESSERA_texture", "KHR_materials_emissive_strength"}) {
    file->use_extension(name);
  }
  file->add("cameras", R"({"type": "perspective", "perspective": {"yfov": 1, "znear": 1},
      "extensions": {"TESSERA_camera": {"lens": {"fNumber": 2, "focusDistance": 1, "blades": 5}}}})");
  file->set("/extensions/KHR_lights_punctual/lights", R"([{"type": "point", "intensity": 1}])");
  file->add("textures", R"({"extensions": {"TESSERA_texture":
      {"pattern": "fire", "time": 0, "seed": 3, "offset": [0, 0, 0]}}})");
  file->add_material(R"({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0},
      "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2}}})");
  file->add_node(R"({"camera": 0})");
  file->add_node(R"({"extensions": {"KHR_lights_punctual": {"light": 0}}})");
  file->add_node_with_mesh(file->add_mesh(unit_quad(0)));
  std::vector<float> values = from;
  values.insert(values.end(), to.begin(), to.end());
  const char* types[] = {"SCALAR", "SCALAR", "VEC2", "VEC3", "VEC4"};
  const int times = file->add_floats("SCALAR", {0, 2});
  const int output = file->add_floats(types[from.size()], values);
  file->add("animations",
            R"({"samplers": [{"input": )" + std::to_string(times) + R"(, "output": )" +
                std::to_string(output) + R"(, "interpolation": ")" + interpolation +
                R"("}], "channels": [{"sampler": 0, "target": {"path": "pointer", "extensions":
                {"KHR_animation_pointer": {"pointer": ")" +
                pointer + R"("}}}}]})");
  return file;
}

/// The scene 1.5 s into the clip: three quarters of the way.
Scene late(const GltfBuilder& file) {
  auto scene = load_and_pose(file, {}, 36);  // at 24 frames a second
  EXPECT_TRUE(scene.ok()) << scene.status();
  Scene out = scene.ok() ? *std::move(scene) : Scene();
  // At least one of each, so that a failure does not crash the test.
  if (out.lights.empty()) out.lights.emplace_back();
  if (out.materials.empty()) out.materials.emplace_back();
  if (out.procedural_textures.empty()) out.procedural_textures.emplace_back();
  return out;
}

TEST(AnimationPointer, AnimatesEveryKindOfProperty) {
  EXPECT_DOUBLE_EQ(late(*animated("/cameras/0/perspective/yfov", {1}, {2})).camera.yfov, 1.75);
  EXPECT_DOUBLE_EQ(
      late(*animated("/cameras/0/extensions/TESSERA_camera/lens/focusDistance", {1}, {5}))
          .camera.lens.focus_distance,
      4);
  EXPECT_EQ(late(*animated("/extensions/KHR_lights_punctual/lights/0/intensity", {1}, {9}))
                .lights[0]
                .intensity,
            (render::Vec3f{7, 7, 7}));
  EXPECT_EQ(
      late(*animated("/extensions/KHR_lights_punctual/lights/0/color", {0, 0, 0}, {1, 0, 0.5}))
          .lights[0]
          .intensity,
      (render::Vec3f{0.75f, 0, 0.375f}));
  EXPECT_EQ(late(*animated("/textures/0/extensions/TESSERA_texture/offset", {0, 0, 0}, {4, 8, 0}))
                .procedural_textures[0]
                .offset,
            (render::Vec3f{3, 6, 0}));
  EXPECT_EQ(
      late(*animated("/materials/0/emissiveFactor", {0, 0, 0}, {1, 0, 1})).materials[0].emission,
      (render::Vec3f{1.5f, 0, 1.5f}));
  // A property with its default value in an object that is absent.
  EXPECT_EQ(late(*animated("/materials/0/pbrMetallicRoughness/roughnessFactor", {1}, {0}))
                .materials[0]
                .roughness,
            0.25f);
  EXPECT_EQ(late(*animated("/nodes/2/translation", {0, 0, 0}, {4, 0, 0})).center.x, 3.5);
  EXPECT_DOUBLE_EQ(late(*animated("/cameras/0/perspective/yfov", {1}, {2}, "STEP")).camera.yfov, 1);
}

TEST(AnimationPointer, DarkLampAddsNoDefaultSky) {
  for (const float last : {1.0f, 2.0f}) {
    const auto file = animated(
        "/materials/0/extensions/KHR_materials_emissive_strength/emissiveStrength", {0}, {last});
    file->set("/nodes/1", "{}");  // without its light
    const auto scene = load_and_pose(*file);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ(scene->materials[0].emission, render::Vec3f{});
    EXPECT_FALSE(scene->has_environment);
  }
}

TEST(AnimationPointer, DarkMediumAddsNoDefaultSky) {
  const auto file = animated("/scenes/0/extensions/TESSERA_medium/emission", {0, 0, 0}, {1, 1, 1});
  file->use_extension("TESSERA_medium");
  file->set("/scenes/0/extensions/TESSERA_medium", R"({"emission": [0, 0, 0], "radius": 3})");
  file->set("/materials/0", "{}");
  file->set("/nodes/1", "{}");  // without its light
  const auto scene = load_and_pose(*file);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->atmosphere->medium.emission, render::Vec3f{});
  EXPECT_FALSE(scene->has_environment);
}

TEST(AnimationPointer, AnimatesOneBlobOfMany) {
  const auto file =
      animated("/nodes/3/extensions/TESSERA_blobs/elements/1/center", {0, 0, 0}, {16, 0, 0});
  file->use_extension("TESSERA_blobs");
  file->add_node(R"({"extensions": {"TESSERA_blobs": {"elements": [
      {"center": [-8, 0, 0]}, {"center": [0, 0, 0], "strength": 4}], "threshold": 1}}})");
  const Scene scene = late(*file);
  ASSERT_FALSE(scene.meshes.empty());
  const render::Mesh& mesh = scene.meshes.back();
  ASSERT_NE(mesh.shape, nullptr);
  EXPECT_NEAR(mesh.shape->bounds.hi.x, 12 + std::sqrt(0.5), 1e-5);
}

/// Cameras, textures and blobs are tested above. TESSERA_csg has no numbers.
TEST(AnimationPointer, AnimatesTesseraExtensions) {
  const auto file_with = [](const std::string& pointer, const std::vector<float>& from,
                            const std::vector<float>& to) {
    auto file = animated(pointer, from, to);
    for (const char* name :
         {"TESSERA_shape", "TESSERA_terrain", "TESSERA_material", "TESSERA_medium"}) {
      file->use_extension(name);
    }
    file->set("/materials/0/extensions/TESSERA_material", R"({"diffuseRoughness": 0})");
    file->set("/scenes/0/extensions/TESSERA_medium",
              R"({"scattering": [1, 1, 1], "emission": [0, 0, 0], "radius": 3})");
    file->add_node(R"({"extensions": {"TESSERA_shape": {"type": "torus", "radius": 1}}})");
    file->add_node(R"({"extensions": {"TESSERA_terrain": {"pattern": "waves", "height": 1,
        "octaves": 1}}})");
    return late(*file);
  };
  const auto shape = [](const Scene& scene, std::int32_t node) {
    for (const render::Instance& instance : scene.instances) {
      if (instance.node == node) return scene.meshes[static_cast<std::size_t>(instance.mesh)].shape;
    }
    return std::shared_ptr<const render::Shape>();
  };
  const Scene torus = file_with("/nodes/3/extensions/TESSERA_shape/radius", {1}, {5});
  ASSERT_NE(shape(torus, 3), nullptr);
  EXPECT_EQ(shape(torus, 3)->radius, 4);
  const float low =
      shape(file_with("/nodes/4/extensions/TESSERA_terrain/height", {1}, {1}), 4)->bounds.hi.y;
  const Scene high = file_with("/nodes/4/extensions/TESSERA_terrain/height", {1}, {5});
  EXPECT_NEAR(shape(high, 4)->bounds.hi.y / low, 4, 1e-5);
  const Scene rough =
      file_with("/materials/0/extensions/TESSERA_material/diffuseRoughness", {0}, {1});
  EXPECT_EQ(rough.materials[0].optics.diffuse_roughness, 0.75f);
  const Scene fog =
      file_with("/scenes/0/extensions/TESSERA_medium/scattering", {0, 0, 0}, {4, 0, 8});
  ASSERT_TRUE(fog.atmosphere.has_value());
  EXPECT_EQ(fog.atmosphere->medium.scattering, (render::Vec3f{3, 0, 6}));
  const Scene glow =
      file_with("/scenes/0/extensions/TESSERA_medium/emission", {0, 0, 0}, {4, 0, 8});
  EXPECT_EQ(glow.atmosphere->medium.emission, (render::Vec3f{3, 0, 6}));
  EXPECT_FALSE(glow.has_environment);
  EXPECT_EQ(file_with("/scenes/0/extensions/TESSERA_medium/radius", {1}, {5}).atmosphere->radius,
            4);
}

std::string refusal(const std::string& pointer, const std::vector<float>& to) {
  const auto file = animated(pointer, std::vector<float>(to.size(), 1), to);
  return std::string(load_and_pose(*file, {}, 36).status().message());
}

/// Warnings of a file that loads and renders.
std::vector<std::string> warnings(const GltfBuilder& file) {
  MemoryReader reader;
  reader.put("scene.gltf", file.gltf());
  const auto loaded = render::load_scene_file("scene.gltf", {}, reader);
  EXPECT_TRUE(loaded.ok()) << loaded.status();
  if (!loaded.ok()) return {};
  const auto scene = (*loaded)->pose({}, 36);
  EXPECT_TRUE(scene.ok()) << scene.status();
  std::vector<std::string> out;
  for (const render::Problem& problem : (*loaded)->problems()) {
    out.push_back(problem.element + ": " + problem.message);
  }
  return out;
}

TEST(AnimationPointer, UnknownTargetIsIgnoredWithWarning) {
  const std::string at =
      "animations[0].channels[0].target.extensions.KHR_animation_pointer.pointer: ";
  for (const char* pointer :
       {"", "cameras/0/perspective/yfov", "/cameras/1/perspective/yfov", "/cameras/0/perspective",
        "/cameras/0/perspective/yfof", "/cameras/x/perspective/yfov", "/asset/version",
        "/materials/0/emissiveTexture/index", "/materials/0/emissiveFactor/0",
        "/materials/0/extensions/KHR_materials_ior/ior",
        "/textures/0/extensions/TESSERA_texture/seed",
        "/textures/0/extensions/TESSERA_texture/gain", "/textures/0/source",
        "/cameras/0/extensions/TESSERA_camera/lens/blades", "/nodes/9/translation", "/nodes/0/mesh",
        "/nodes/2/weights", "/meshes/0/weights/0", "/meshes/0/name"}) {
    EXPECT_EQ(warnings(*animated(pointer, {1}, {2})),
              std::vector<std::string>{at + "\"" + pointer +
                                       "\" is not an animatable property; channel ignored"});
  }
}

TEST(AnimationPointer, TargetWithoutEffectIsAccepted) {
  for (const char* pointer : {"/cameras/0/perspective/aspectRatio", "/cameras/0/orthographic/xmag",
                              "/materials/0/occlusionTexture/strength"}) {
    EXPECT_EQ(warnings(*animated(pointer, {1}, {0.5f})), std::vector<std::string>{}) << pointer;
  }
}

TEST(AnimationPointer, AnimatesVisibility) {
  for (const float last : {0.0f, 1.0f}) {
    const auto file =
        animated("/nodes/2/extensions/KHR_node_visibility/visible", {last}, {0}, "STEP");
    file->use_extension("KHR_node_visibility");
    file->set("/nodes/2/extensions/KHR_node_visibility/visible", "true");
    EXPECT_EQ(late(*file).instances.size(), last == 0 ? 0u : 1u);
  }
}

TEST(AnimationPointer, AnimatesWeightsOfMeshesAndNodes) {
  for (const char* pointer :
       {"/meshes/0/weights", "/meshes/0/weights/0", "/nodes/2/weights", "/nodes/2/weights/0"}) {
    const auto file = animated(pointer, {0}, {4});
    const int offset = file->add_vec3(std::vector<render::Vec3f>(4, {2, 0, 0}));
    file->set("/meshes/0/primitives/0/targets",
              R"([{"POSITION": )" + std::to_string(offset) + "}]");
    // At 1.5 of 2 s the weight is 3, which moves the quad by 6.
    EXPECT_EQ(late(*file).center.x, 6.5) << pointer;
  }
}

TEST(AnimationPointer, RejectsWrongTypesAndRanges) {
  EXPECT_EQ(refusal("/materials/0/emissiveFactor", {2, 2}),
            "scene.gltf: accessors[4]: has 2 components, expected 3");
  EXPECT_EQ(refusal("/extensions/KHR_lights_punctual/lights/0/intensity", {-9}),
            "scene.gltf: extensions.KHR_lights_punctual.lights[0].intensity: -6.5 is not in [0, "
            "1e+30]");
}

TEST(AnimationPointer, FrameOrderDoesNotMatter) {
  const auto file = animated("/materials/0/emissiveFactor", {0, 0, 0}, {1, 0, 1});
  MemoryReader reader;
  reader.put("scene.gltf", file->gltf());
  const auto loaded = render::load_scene_file("scene.gltf", {}, reader);
  ASSERT_TRUE(loaded.ok());
  ASSERT_TRUE((*loaded)->pose({}, 0).ok());
  for (const std::int32_t frame : {36, 12, 36}) {
    const auto scene = (*loaded)->pose({}, frame);
    ASSERT_TRUE(scene.ok());
    EXPECT_EQ(scene->materials[0].emission.x, static_cast<float>(frame) / 24);
  }
  EXPECT_EQ((*loaded)->contents().animations[0].seconds, 2);
}

}  // namespace
}  // namespace tessera::testing
