// CSG solids from the file to the pixel: materials of operands, and glass.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "tests/support/render/gltf_probe.h"

namespace tessera::testing {
namespace {

using render::Vec3d;

std::string shape(const std::string& content, int material, const std::string& more = "") {
  return R"({"extensions": {"TESSERA_shape": {)" + content + R"(, "material": )" +
         std::to_string(material) + "}}" + more + "}";
}

/// A solid of two operands.
void add_solid(GltfBuilder& file, const std::string& operation, const std::string& first,
               const std::string& second) {
  file.use_extension("TESSERA_shape");
  file.use_extension("TESSERA_csg");
  const int a = file.add_node(first, false), b = file.add_node(second, false);
  file.add_node(R"({"children": [)" + std::to_string(a) + ", " + std::to_string(b) +
                R"(], "extensions": {"TESSERA_csg": {"operation": ")" + operation + R"("}}})");
}

/// Colour of a solid of a box of 2 m and a sphere of 0.5 m, half in its front face, of different
/// colours.
Vec3d colour_of(const std::string& operation, double x, const std::string& ball_scale = "1, 1, 1",
                const std::string& box_scale = "1, 1, 1") {
  const auto file = probe_of(x, 0.01);
  file->use_extension("KHR_materials_unlit");
  const auto paint = [&file](const std::string& color) {
    return file->add_material(R"({"pbrMetallicRoughness": {"baseColorFactor": )" + color +
                              R"(}, "extensions": {"KHR_materials_unlit": {}}})");
  };
  const int red = paint("[1, 0, 0, 1]"), green = paint("[0, 1, 0, 1]");
  add_solid(*file, operation,
            shape(R"("type": "box", "size": [2, 2, 2])", red, R"(, "scale": [)" + box_scale + "]"),
            shape(R"("type": "sphere", "radius": 0.5)", green,
                  R"(, "translation": [0, 0, 1], "scale": [)" + ball_scale + "]"));
  return seen(*file, probe_settings());
}

TEST(Csg, SurfaceUsesMaterialOfItsOperand) {
  const Vec3d red = {1, 0, 0}, green = {0, 1, 0};
  for (const char* operation : {"union", "subtraction", "xor"}) {
    EXPECT_EQ(colour_of(operation, 0.1), green) << operation;  // wall of the hole
    EXPECT_EQ(colour_of(operation, 0.8), red) << operation;
  }
  EXPECT_EQ(colour_of("intersection", 0.1), red);  // the box's face cuts the ball
}

TEST(Csg, OperandOfScaleZeroIsEmpty) {
  const Vec3d red = {1, 0, 0}, green = {0, 1, 0}, nothing = {1, 1, 1};  // the default sky
  for (const char* scale : {"0, 0, 0", "1, 0, 1"}) {
    for (const char* operation : {"union", "subtraction", "xor"}) {
      EXPECT_EQ(colour_of(operation, 0.1, scale), red) << operation;
    }
    EXPECT_EQ(colour_of("intersection", 0.1, scale), nothing);
    EXPECT_EQ(colour_of("union", 0.1, "1, 1, 1", scale), green);
    EXPECT_EQ(colour_of("subtraction", 0.1, "1, 1, 1", scale), nothing);
    EXPECT_EQ(colour_of("union", 0.1, scale, scale), nothing);
  }
}

TEST(Csg, DeepNestingLoadsAndRenders) {
  const auto file = probe_of(0, 0.01);
  file->use_extension("KHR_materials_unlit");
  file->use_extension("TESSERA_shape");
  file->use_extension("TESSERA_csg");
  const int green = file->add_material(
      R"({"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]},
          "extensions": {"KHR_materials_unlit": {}}})");
  const auto ball = [&] {
    return std::to_string(file->add_node(shape(R"("type": "sphere", "radius": 1)", green), false));
  };
  std::string inner = ball();
  constexpr int kLevels = 100'000;  // 10 MB of stack by recursion
  for (int level = 1; level <= kLevels; ++level) {
    const bool outermost = level == kLevels;
    std::string node = R"({"children": [)";
    node += inner;
    if (level % 10'000 == 0) node += ", " + ball();
    node += R"(], "extensions": {"TESSERA_csg": {"operation": "union"}}})";
    inner = std::to_string(file->add_node(node, outermost));
  }
  EXPECT_EQ(seen(*file, probe_settings()), (Vec3d{0, 1, 0}));
}

/// The intersection of two balls whose centres are 1 m apart along the camera's rays, of glass
/// visible only by absorption: 2 sqrt(1 - x^2) - 1 thick at distance x from the axis.
TEST(Csg, GlassLensAbsorbsAlongPath) {
  for (const double x : {0.0, 0.3, 0.7, 0.95}) {
    const auto file = probe_of(x, 0);
    for (const char* name :
         {"KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_ior"}) {
      file->use_extension(name);
    }
    const int glass = file->add_material(
        R"({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0}, "extensions": {
            "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_ior": {"ior": 1}, "KHR_materials_volume": {"thicknessFactor": 1,
            "attenuationDistance": 0.5, "attenuationColor": [1, 0.5, 0.2]}}})");
    const std::string ball = R"("type": "sphere", "radius": 1)";
    add_solid(*file, "intersection", shape(ball, glass, R"(, "translation": [0, 0, 0.5])"),
              shape(ball, glass, R"(, "translation": [0, 0, -0.5])"));
    contract::RenderSettings settings = probe_settings();
    settings.max_depth = 8;
    settings.background = contract::Background::color;
    settings.background_color = {1, 1, 1};
    const double thick = std::max(2 * std::sqrt(1 - x * x) - 1, 0.0);
    const Vec3d found = seen(*file, settings);
    EXPECT_NEAR(found.x, 1, 1e-5) << x;
    EXPECT_NEAR(found.y, std::pow(0.5, thick / 0.5), 1e-4) << x;
    EXPECT_NEAR(found.z, std::pow(0.2, thick / 0.5), 1e-4) << x;
  }
}

/// Radiance of a white wall seen through a ball of radius 1 m and index 1, which also shades it
/// from the sun.
Vec3d wall_behind_a_ball(double x, const std::string& ball) {
  const auto file = probe_of(x, 0);
  for (const char* name : {"TESSERA_shape", "KHR_materials_transmission", "KHR_materials_volume",
                           "KHR_materials_ior", "KHR_materials_specular"}) {
    file->use_extension(name);
  }
  add_sun(*file, 1);
  TriangleMesh wall = unit_quad(file->add_material(
      R"({"pbrMetallicRoughness": {"metallicFactor": 0},
          "extensions": {"KHR_materials_specular": {"specularFactor": 0}}})"));
  for (render::Vec3f& p : wall.positions) p = p * 8.0f - render::Vec3f{3, 5, 2};
  file->add_node_with_mesh(file->add_mesh(wall));
  if (!ball.empty()) {
    const int glass = file->add_material(
        R"({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.5)" + ball +
        R"(}, "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_ior": {"ior": 1}, "KHR_materials_volume": {"thicknessFactor": 1,
            "attenuationDistance": 2, "attenuationColor": [1, 0.5, 0.25]}}})");
    file->add_node(shape(R"("type": "sphere", "radius": 1)", glass));
  }
  return seen(*file, probe_settings());
}

TEST(IndexOneSolid, TransmitsAndAbsorbsSunlight) {  // hard case 41
  constexpr double kWhite = 1 / 3.14159265358979323846;
  for (const double x : {0.0, 0.5, 0.9}) {
    const double distance = 2 * 2 * std::sqrt(1 - x * x);  // to the wall and back, in metres
    const Vec3d bare = wall_behind_a_ball(x, ""), seen = wall_behind_a_ball(x, ", \"extras\": 0");
    EXPECT_NEAR(bare.x, kWhite, 1e-6);
    EXPECT_EQ(seen.x, bare.x) << x;
    EXPECT_NEAR(seen.y, kWhite * std::pow(0.5, distance / 2), 1e-5) << x;
    EXPECT_NEAR(seen.z, kWhite * std::pow(0.25, distance / 2), 1e-5) << x;
  }
  // A base colour tints at the surface, so the surface stays, and light of points and suns does not
  // pass.
  EXPECT_EQ(wall_behind_a_ball(0, R"(, "baseColorFactor": [1, 1, 0.5, 1])").x, 0);
}

}  // namespace
}  // namespace tessera::testing
