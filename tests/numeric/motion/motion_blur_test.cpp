/// Motion blur: images of moving objects equal the average of many sharp images.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "tests/numeric/motion/motion_files.h"
#include "tests/support/memory_scene.h"
#include "worker/accel/scene_accel.h"
#include "worker/gltf/build/loader.h"
#include "worker/scene/features.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::GltfBuilder;
using tessera::testing::load_and_pose;
using tessera::testing::Picture;
using tessera::testing::render_picture;

constexpr double kOpen = 0.1, kClose = 0.9;  // seconds

int shining(GltfBuilder& b, const std::string& color) {
  return b.add_material(R"({"emissiveFactor": )" + color +
                        R"(, "doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0}})");
}

/// An upright mesh at z = 0 that begins at x, 2 m high.
int add_stripe(GltfBuilder& b, float x, float width, int material) {
  tessera::testing::TriangleMesh mesh;
  mesh.positions = {{x, -1, 0}, {x + width, -1, 0}, {x + width, 1, 0}, {x, 1, 0}};
  mesh.indices = {0, 1, 2, 0, 2, 3};
  mesh.material = material;
  return b.add_mesh(mesh);
}

void add_wall(GltfBuilder& b) {
  const int paint = b.add_material(R"({"pbrMetallicRoughness": {"metallicFactor": 0}})");
  b.add_node_with_mesh(add_stripe(b, -9, 18, paint), R"({"translation": [0, 0, -1]})");
}

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

/// Mean and squared standard error of a pixel's channels over independent images.
struct Estimate {
  std::vector<double> sum, squares;
  double count = 0;
  void add(const std::vector<double>& rgb) {
    sum.resize(rgb.size());
    squares.resize(rgb.size());
    for (std::size_t i = 0; i < rgb.size(); ++i) {
      sum[i] += rgb[i];
      squares[i] += rgb[i] * rgb[i];
    }
    ++count;
  }
  double mean(std::size_t i) const { return sum[i] / count; }
  double error2(std::size_t i) const {
    return std::max(squares[i] / count - mean(i) * mean(i), 0.0) / (count - 1);
  }
};

/// Expects blurred images to equal the average of many sharp ones, each of the file without a
/// shutter at a time of its own.
void expect_average(std::unique_ptr<GltfBuilder> (*make)(double open, double close),
                    std::uint32_t pictures) {
  constexpr double kTick = 1e-6;
  constexpr int kTimes = 32;  // strata
  const auto blurred = make(kOpen, kClose), sharp = make(0, 0);
  auto settings = all_animations();
  settings.max_depth = 1;
  settings.fps = 1 / kTick;
  const auto scene = load_and_pose(*blurred, settings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  tessera::testing::MemoryReader reader;
  reader.put("scene.gltf", sharp->gltf());
  const auto file = load_scene_file("scene.gltf", settings, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  Estimate blur, average;
  for (std::uint32_t seed = 0; seed < pictures; ++seed) {
    settings.seed = seed;
    settings.spp = 512;
    blur.add(render_picture(*scene, settings).rgb);
    settings.spp = 8;
    std::vector<double> sum;
    for (int i = 0; i < kTimes; ++i) {
      const double time = kOpen + (i + uniform(rng)) / kTimes * (kClose - kOpen);
      settings.seed = 1000 + seed * kTimes + static_cast<std::uint32_t>(i);
      const auto now =
          (*file)->pose(settings, static_cast<std::int32_t>(std::lround(time / kTick)));
      ASSERT_TRUE(now.ok()) << now.status();
      const Picture one = render_picture(*now, settings);
      sum.resize(one.rgb.size());
      for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += one.rgb[k] / kTimes;
    }
    average.add(sum);
  }
  settings.spp = 8 * kTimes;
  const auto middle =
      (*file)->pose(settings, static_cast<std::int32_t>(std::lround((kOpen + kClose) / 2 / kTick)));
  ASSERT_TRUE(middle.ok()) << middle.status();
  const Picture frozen = render_picture(*middle, settings);
  double largest = 0, largest_if_frozen = 0;
  const std::size_t count = blur.sum.size();
  for (std::size_t i = 0; i < count; ++i) {
    const double error = std::sqrt(blur.error2(i) + average.error2(i));
    const double off = std::abs(blur.mean(i) - average.mean(i));
    if (off > 1e-6) largest = std::max(largest, off / error);
    const double off_if_frozen = std::abs(frozen.rgb[i] - average.mean(i));
    if (off_if_frozen > 1e-6)
      largest_if_frozen = std::max(largest_if_frozen, off_if_frozen / error);
  }
  // The largest of 72 values of t with 15 degrees of freedom exceeds 5.1 once in 100 times. Paths
  // deviate by at most 4/3 2^-10 of 2 m, a fiftieth of a pixel.
  EXPECT_LT(largest, 5.1);
  EXPECT_GT(largest_if_frozen, 2 * 5.1) << "a frozen object would not be detected";
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
