/// Objects whose scale is zero during a part of the exposure.

#include <gtest/gtest.h>

#include "tests/numeric/motion/average_of_sharp.h"
#include "tests/numeric/motion/motion_files.h"
#include "tests/support/scene/memory_scene.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::GltfBuilder;
using tessera::testing::load_and_pose;

using Values = std::vector<float>;

constexpr float kTurn = 0.3f, kEnd = 0.7f;  // seconds, within the exposure
const Values turn_times = {0, kTurn, kEnd, 1};
const Values growing_scales = {0, 0, 0, 0, 0, 0, 1, 1, 1, 1.2f, 1.2f, 1.2f};
const Values shrinking_scales = {1.2f, 1.2f, 1.2f, 1, 1, 1, 0, 0, 0, 0, 0, 0};
const Values appearing_scales = {0, 0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0};
const Values mirroring_scales = {-1, -1, -1, -0.5f, -0.5f, -0.5f, 0.5f, 0.5f, 0.5f, 1, 1, 1};
const Values flipping_scales = {-1, 1, 1, -1, 1, 1, 1, 0.5f, 1, 1, 0.5f, 1};

std::string at(const std::string& place) {
  return R"({"translation": )" + place + "}";
}

/// A lamp outside the view: a mesh, emitting to its front only.
int add_lamp(GltfBuilder& b, const std::string& color, const std::string& place) {
  const int glow = b.add_material(R"({"emissiveFactor": )" + color +
                                  R"(, "pbrMetallicRoughness": {"metallicFactor": 0}})");
  tessera::testing::TriangleMesh mesh;  // faces the wall
  mesh.positions = {{-0.1f, -0.15f, 0}, {0.1f, -0.15f, 0}, {0.1f, 0.15f, 0}, {-0.1f, 0.15f, 0}};
  mesh.indices = {0, 2, 1, 0, 3, 2};
  mesh.material = glow;
  return b.add_node_with_mesh(b.add_mesh(mesh), at(place));
}

int add_bulb(GltfBuilder& b, const std::string& color, const std::string& shape,
             const std::string& place) {
  b.use_extension("TESSERA_shape");
  return b.add_node(R"({"translation": )" + place + R"(, "extensions": {"TESSERA_shape": {)" +
                    shape + R"(, "material": )" + number(shining(b, color)) + "}}}");
}

std::unique_ptr<GltfBuilder> wall(double open, double close) {
  auto file = std::make_unique<GltfBuilder>();
  add_camera(*file, open, close);
  add_wall(*file);
  return file;
}

std::unique_ptr<GltfBuilder> lamps(double open, double close) {
  auto file = wall(open, close);
  animate(*file, add_lamp(*file, "[5, 0, 0]", "[-0.6, 0.5, -0.5]"), "scale", turn_times, "VEC3",
          growing_scales);
  animate(*file, add_lamp(*file, "[0, 5, 0]", "[0.5, -0.5, -0.4]"), "scale", turn_times, "VEC3",
          shrinking_scales);
  animate(*file, add_lamp(*file, "[0, 0, 5]", "[0, 0.6, -0.6]"), "scale", turn_times, "VEC3",
          appearing_scales);
  return file;
}

std::unique_ptr<GltfBuilder> mirrored_lamps(double open, double close) {
  auto file = wall(open, close);
  animate(*file, add_lamp(*file, "[5, 0, 0]", "[-0.6, 0.5, -0.5]"), "scale", turn_times, "VEC3",
          mirroring_scales);
  animate(*file, add_lamp(*file, "[0, 5, 0]", "[0.5, -0.5, -0.4]"), "scale", turn_times, "VEC3",
          flipping_scales);
  return file;
}

std::unique_ptr<GltfBuilder> bulbs(double open, double close) {
  auto file = wall(open, close);
  GltfBuilder& b = *file;
  const std::string ball = R"("type": "sphere", "radius": 0.15)";
  animate(b, add_bulb(b, "[5, 0, 0]", ball, "[-0.6, 0.5, -0.5]"), "scale", turn_times, "VEC3",
          growing_scales);
  animate(b, add_bulb(b, "[0, 5, 0]", R"("type": "disc", "radius": 0.2)", "[0.5, 0.6, -0.6]"),
          "scale", turn_times, "VEC3", shrinking_scales);
  animate(b,
          add_bulb(b, "[0, 0, 9]", R"("type": "cylinder", "radius": 0.01, "height": 1.2)",
                   "[0, -0.8, -0.5]"),
          "scale", turn_times, "VEC3", flipping_scales);
  return file;
}

/// Objects in view: a mesh, instances and a shape.
std::unique_ptr<GltfBuilder> objects(double open, double close) {
  auto file = wall(open, close);
  GltfBuilder& b = *file;
  const int grows =
      b.add_node_with_mesh(add_stripe(b, -0.2f, 0.4f, shining(b, "[1, 0.2, 0]")), at("[-1, 0, 0]"));
  animate(b, grows, "scale", turn_times, "VEC3", growing_scales);
  b.use_extension("EXT_mesh_gpu_instancing");
  const int places = b.add_vec3({{-0.2f, 0, 0}, {0.3f, 0, 0}});
  const int row = b.add_node_with_mesh(
      add_stripe(b, -0.1f, 0.2f, shining(b, "[0, 1, 0.3]")),
      R"({"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": )" +
          number(places) + "}}}}");
  animate(b, row, "scale", turn_times, "VEC3", shrinking_scales);
  const int ball = add_bulb(b, "[0.1, 0, 1]", R"("type": "sphere", "radius": 0.3)", "[0.9, 0, 0]");
  animate(b, ball, "scale", turn_times, "VEC3", mirroring_scales);
  return file;
}

/// A solid in view of which one operand grows from nothing and one vanishes.
std::unique_ptr<GltfBuilder> solid(double open, double close) {
  auto file = wall(open, close);
  GltfBuilder& b = *file;
  b.use_extension("TESSERA_shape");
  b.use_extension("TESSERA_csg");
  const int glow = shining(b, "[1, 0.5, 0.2]");
  const auto add_operand = [&](const std::string& shape, const std::string& place) {
    return b.add_node(R"({"translation": )" + place + R"(, "extensions": {"TESSERA_shape": {)" +
                          shape + R"(, "material": )" + number(glow) + "}}}",
                      false);
  };
  const int body = add_operand(R"("type": "box", "size": [2, 2, 0.2])", "[0, 0, 0]");
  const int hole = add_operand(R"("type": "sphere", "radius": 0.5)", "[-0.5, 0, 0]");
  const int gone = add_operand(R"("type": "sphere", "radius": 0.4)", "[0.6, 0, 0]");
  b.add_node(R"({"children": [)" + number(body) + ", " + number(hole) + ", " + number(gone) +
             R"(], "extensions": {"TESSERA_csg": {"operation": "subtraction"}}})");
  animate(b, hole, "scale", turn_times, "VEC3", growing_scales);
  animate(b, gone, "scale", turn_times, "VEC3", shrinking_scales);
  return file;
}

/// Punctual lights below nodes that grow and shrink: their light does not change.
std::unique_ptr<GltfBuilder> punctual_lights(double open, double close) {
  auto file = wall(open, close);
  GltfBuilder& b = *file;
  b.use_extension("KHR_lights_punctual");
  b.set("/extensions/KHR_lights_punctual/lights",
        R"([{"type": "point", "color": [1, 0, 0], "intensity": 3},
            {"type": "spot", "color": [0, 1, 0], "intensity": 8,
             "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.3}}])");
  for (int light = 0; light < 2; ++light) {
    const int child = b.add_node(R"({"translation": [0.5, 0.2, 0.4], "extensions": {
        "KHR_lights_punctual": {"light": )" +
                                     number(light) + "}}}",
                                 false);
    const int parent = b.add_node(R"({"children": [)" + number(child) + "]}");
    animate(b, parent, "scale", turn_times, "VEC3", light == 0 ? growing_scales : shrinking_scales);
  }
  return file;
}

TEST(ZeroScale, LampsEqualAverage) {
  expect_average(lamps, 16);
}

TEST(ZeroScale, MirroredLampsEqualAverage) {
  expect_average(mirrored_lamps, 16);
}

TEST(ZeroScale, ShapesAsLampsEqualAverage) {
  expect_average(bulbs, 16);
}

TEST(ZeroScale, ObjectsInViewEqualAverage) {
  expect_average(objects, 16);
}

TEST(ZeroScale, OperandsEqualAverage) {
  expect_average(solid, 16);
}

TEST(ZeroScale, PunctualLightsEqualAverage) {
  expect_average(punctual_lights, 16);
}

}  // namespace
}  // namespace tessera::render::testing
