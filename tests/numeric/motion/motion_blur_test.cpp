/// Motion blur: images of moving objects equal the average of many sharp images.

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "tests/numeric/motion/average_of_sharp.h"
#include "tests/numeric/motion/motion_files.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/accel/scene_accel.h"
#include "worker/gltf/build/loader.h"
#include "worker/scene/features.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::GltfBuilder;
using tessera::testing::load_and_pose;

/// Turns a node about an axis at constant speed from 0 s to 1 s.
void turn(GltfBuilder& b, int node, const Vec3f& axis, double from, double to) {
  std::vector<float> values;
  for (const double angle : {from, to}) {
    const auto sine = static_cast<float>(std::sin(0.5 * angle));
    for (int k = 0; k < 3; ++k) values.push_back(axis[k] * sine);
    values.push_back(static_cast<float>(std::cos(0.5 * angle)));
  }
  animate(b, node, "rotation", {0, 1}, "VEC4", values);
}

/// A row of emissive objects under light from the side: one translates, one rotates, one scales,
/// one is skinned. They light the wall behind, and the camera moves.
std::unique_ptr<GltfBuilder> moving_row(double open, double close) {
  auto file = std::make_unique<GltfBuilder>();
  GltfBuilder& b = *file;
  const int camera = add_camera(b, open, close);
  animate(b, camera, "translation", {0, 1}, "VEC3", {0, 0, 5, 0.1f, 0, 4.5f});
  const auto half = static_cast<float>(std::sin(0.02)), rest = static_cast<float>(std::cos(0.02));
  animate(b, camera, "rotation", {0, 1}, "VEC4", {0, 0, 0, 1, 0, half, 0, rest});
  b.use_extension("KHR_lights_punctual");
  b.set("/extensions/KHR_lights_punctual/lights", R"([{"type": "directional", "intensity": 3}])");
  b.add_node(R"({"rotation": [0, 0.38268343, 0, 0.92387953],
                 "extensions": {"KHR_lights_punctual": {"light": 0}}})");
  add_wall(b);
  const int along = b.add_node_with_mesh(add_stripe(b, 0, 0.3f, shining(b, "[1, 0.2, 0]")));
  animate(b, along, "translation", {0, 0.4f, 1}, "VEC3", {-1.5f, 0, 0, -0.9f, 0, 0, -1.2f, 0, 0});
  const int round = b.add_node_with_mesh(add_stripe(b, 0.1f, 0.3f, shining(b, "[0, 1, 0.3]")));
  const auto s = static_cast<float>(std::sin(0.6)), c = static_cast<float>(std::cos(0.6));
  animate(b, round, "rotation", {0, 1}, "VEC4", {0, -s, 0, c, 0, s, 0, c});
  const int growing = add_stripe(b, 0.6f, 0.2f, shining(b, "[0.1, 0, 1]"));
  const int moves = b.add_vec3({{0, 0, 0}, {0.5f, 0, 0}, {0.5f, 0, 0}, {0, 0, 0}});
  b.set("/meshes/" + number(growing) + "/primitives/0/targets",
        R"([{"POSITION": )" + number(moves) + "}]");
  const int grown = b.add_node_with_mesh(growing);
  animate(b, grown, "weights", {0, 1}, "SCALAR", {0, 1});
  // Skinned to a joint that turns about z.
  const int bent = add_stripe(b, -0.5f, 0.2f, shining(b, "[0.5, 0.5, 0]"));
  const std::vector<std::uint8_t> joints(16, 0);
  tessera::testing::AccessorSpec spec;
  spec.view = b.add_view(tessera::testing::bytes_of(joints));
  spec.component_type = tessera::testing::kUnsignedByte;
  spec.count = 4;
  spec.type = "VEC4";
  b.set("/meshes/" + number(bent) + "/primitives/0/attributes/JOINTS_0",
        number(b.add_accessor(spec)));
  b.set("/meshes/" + number(bent) + "/primitives/0/attributes/WEIGHTS_0",
        number(b.add_vec4({{1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}})));
  const int joint = b.add_node("{}");
  animate(b, joint, "rotation", {0, 1}, "VEC4",
          {0, 0, 0, 1, 0, 0, s / 4, std::sqrt(1 - s * s / 16)});
  b.add("skins", R"({"joints": [)" + number(joint) + "]}");
  b.add_node_with_mesh(bent, R"({"skin": 0})");
  return file;
}

/// Punctual lights: red translates, green turns its cone, blue rotates.
std::unique_ptr<GltfBuilder> moving_lights(double open, double close) {
  auto file = std::make_unique<GltfBuilder>();
  GltfBuilder& b = *file;
  add_camera(b, open, close);
  add_wall(b);
  b.use_extension("KHR_lights_punctual");
  b.set("/extensions/KHR_lights_punctual/lights",
        R"([{"type": "point", "color": [1, 0, 0], "intensity": 3},
            {"type": "spot", "color": [0, 1, 0], "intensity": 8,
             "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.3}},
            {"type": "directional", "color": [0, 0, 1], "intensity": 4}])");
  const auto add_light = [&b](int light, const std::string& place) {
    return b.add_node(R"({"translation": )" + place +
                      R"(, "extensions": {"KHR_lights_punctual": {"light": )" + number(light) +
                      "}}}");
  };
  animate(b, add_light(0, "[0, 0, 0]"), "translation", {0, 0.4f, 1}, "VEC3",
          {-1, 0.3f, 0, 0.5f, 0.5f, 0.2f, 1, 0.2f, -0.4f});
  turn(b, add_light(1, "[0, 0, 1]"), {0, 1, 0}, -0.4, 0.5);
  turn(b, add_light(2, "[0, 0, 0]"), {0, 1, 0}, 0.2, 1.4);
  return file;
}

/// Lamps outside the view: red translates and rotates, green is morphed, blue scales.
std::unique_ptr<GltfBuilder> moving_lamps(double open, double close) {
  auto file = std::make_unique<GltfBuilder>();
  GltfBuilder& b = *file;
  add_camera(b, open, close);
  add_wall(b);
  const auto add_lamp = [&b](const std::string& color, const std::string& place) {
    return b.add_node_with_mesh(add_stripe(b, -0.1f, 0.2f, shining(b, color)),
                                R"({"scale": [1, 0.15, 1], "translation": )" + place + "}");
  };
  const int along = add_lamp("[5, 0, 0]", "[0, 0.4, -0.5]");
  animate(b, along, "translation", {0, 1}, "VEC3", {-1, 0.4f, -0.5f, 1, 0.6f, -0.4f});
  turn(b, along, {1, 0, 0}, 0.3, 1.8);
  const int bent = add_stripe(b, -0.1f, 0.2f, shining(b, "[0, 5, 0]"));
  const int moves = b.add_vec3({{0, 0, 0}, {0.5f, 0, 0.3f}, {0.3f, 0, 0}, {0, 0, 0.2f}});
  b.set("/meshes/" + number(bent) + "/primitives/0/targets",
        R"([{"POSITION": )" + number(moves) + "}]");
  const int node =
      b.add_node_with_mesh(bent, R"({"scale": [1, 0.2, 1], "translation": [0.3, -0.5, -0.6]})");
  animate(b, node, "weights", {0, 1}, "SCALAR", {-1, 1});
  const int grows = add_lamp("[0, 0, 5]", "[-0.6, -0.5, -0.5]");
  animate(b, grows, "scale", {0, 1}, "VEC3", {0.3f, 0.02f, 1, 1.5f, 0.3f, 1});
  return file;
}

/// The same with shapes: a red sphere translates, a green disc and a thin blue cylinder rotate.
std::unique_ptr<GltfBuilder> moving_bulbs(double open, double close) {
  auto file = std::make_unique<GltfBuilder>();
  GltfBuilder& b = *file;
  add_camera(b, open, close);
  add_wall(b);
  b.use_extension("TESSERA_shape");
  const auto add_bulb = [&b](const std::string& color, const std::string& shape,
                             const std::string& place) {
    return b.add_node(R"({"translation": )" + place + R"(, "extensions": {"TESSERA_shape": {)" +
                      shape + R"(, "material": )" + number(shining(b, color)) + "}}}");
  };
  const int ball = add_bulb("[5, 0, 0]", R"("type": "sphere", "radius": 0.1)", "[0, 0.4, -0.5]");
  animate(b, ball, "translation", {0, 1}, "VEC3", {-1, 0.4f, -0.5f, 1, 0.6f, -0.4f});
  const int disc = add_bulb("[0, 5, 0]", R"("type": "disc", "radius": 0.2)", "[0.5, 0.5, -0.6]");
  turn(b, disc, {0, 0, 1}, 0, 2.5);
  const int tube = add_bulb("[0, 0, 9]", R"("type": "cylinder", "radius": 0.01, "height": 1.2)",
                            "[0, -0.8, -0.5]");
  turn(b, tube, {0, 0, 1}, 0.9, 1.9);
  return file;
}

/// A ball of smoke that rotates and translates before an emissive wall.
std::unique_ptr<GltfBuilder> moving_smoke(double open, double close) {
  auto file = std::make_unique<GltfBuilder>();
  GltfBuilder& b = *file;
  add_camera(b, open, close);
  b.add_node_with_mesh(add_stripe(b, -9, 18, shining(b, "[1, 1, 1]")),
                       R"({"translation": [0, 0, -1]})");
  for (const char* name : {"TESSERA_shape", "TESSERA_medium", "TESSERA_texture"}) {
    b.use_extension(name);
  }
  b.add("textures", R"({"extensions": {"TESSERA_texture": {"pattern": "noise",
      "scale": [3, 3, 3], "ramp": [{"at": 0.4, "color": [0, 0, 0, 1]},
                                   {"at": 0.6, "color": [1, 1, 1, 1]}]}}})");
  const int smoke = b.add_material(R"({"extensions": {"TESSERA_medium": {
      "absorption": [1, 2, 4], "density": {"texture": 0}}}})");
  const int ball = b.add_node(R"({"extensions": {"TESSERA_shape": {"type": "sphere",
      "radius": 0.8, "material": )" +
                              number(smoke) + "}}}");
  animate(b, ball, "translation", {0, 1}, "VEC3", {-0.5f, 0, 0, 0.5f, 0, 0});
  turn(b, ball, {0, 0, 1}, 0, 1);
  return file;
}

/// Transforms, skins, morphs and cameras.
TEST(MotionBlur, EqualsAverageOfSharpFrames) {
  expect_average(moving_row, 16);
}

TEST(MotionBlur, PunctualLightsEqualAverage) {
  expect_average(moving_lights, 16);
}

TEST(MotionBlur, LampsEqualAverage) {
  expect_average(moving_lamps, 16);
  expect_average(moving_bulbs, 16);
}

TEST(MotionBlur, SmokeEqualsAverage) {
  expect_average(moving_smoke, 16);
}

TEST(MotionBlur, MovingSceneHasMotionKeys) {
  const auto settings = all_animations();
  const auto scene = load_and_pose(*moving_row(kOpen, kClose), settings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->motions.size(), 2u);
  EXPECT_GT(scene->camera.keys.size(), 1u);
  const SceneFeatures features = features_of(*scene);
  const SceneFeatures less = features_of(*load_and_pose(*moving_row(0, 0), settings));
  EXPECT_EQ(features.features, less.features | kFeatureMotion);
  EXPECT_GT(features.total_bytes(), less.total_bytes());
  const auto lit = load_and_pose(*moving_lights(kOpen, kClose), settings);
  ASSERT_TRUE(lit.ok()) << lit.status();
  EXPECT_TRUE((features_of(*lit).features & kFeatureMotion) != 0);
  EXPECT_TRUE(lit->motions.empty() && lit->camera.keys.empty());
  const ParallelFor in_turn = [](std::int64_t count, const auto& body) {
    for (std::int64_t i = 0; i < count; ++i) body(i);
  };
  EXPECT_FALSE(SceneAccel(*scene, in_turn).takes_packets());
  EXPECT_TRUE(SceneAccel(*lit, in_turn).takes_packets()) << "no surface moves";
  for (const PunctualLight& light : lit->lights)
    EXPECT_EQ(light.keys.size(), lit->key_times.size());
}

}  // namespace
}  // namespace tessera::render::testing
