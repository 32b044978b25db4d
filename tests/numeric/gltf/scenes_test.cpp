/// glTF lights, cameras and nodes, from the file to the pixel.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "contract/hilbert.h"
#include "tests/support/render/gltf_probe.h"
#include "tests/support/scene/memory_scene.h"
#include "tests/support/scene/plain_scene.h"

namespace tessera::testing {
namespace {

using render::Vec3d;
using render::Vec3f;

std::string text(double value) {
  std::array<char, 32> digits{};
  std::snprintf(digits.data(), digits.size(), "%.17g", value);
  return digits.data();
}

std::string text(const Vec3d& v) {
  return "[" + text(v.x) + ", " + text(v.y) + ", " + text(v.z) + "]";
}

constexpr const char* kWhiteLambert =
    R"({"pbrMetallicRoughness": {"metallicFactor": 0},
        "extensions": {"KHR_materials_specular": {"specularFactor": 0}}})";

/// KHR_lights_punctual's falloff between the cones, in double, without the floor of its example.
double spot_share(double angle, double inner, double outer) {
  const double ramp = std::cos(inner) - std::cos(outer);
  if (!(ramp > 0)) return angle < outer ? 1 : 0;
  const double a = std::min(std::max((std::cos(angle) - std::cos(outer)) / ramp, 0.0), 1.0);
  return a * a;
}

/// Radiance of a white wall z = 0 lit by a spot of 1 candela 1 m before its origin, at the point
/// whose direction from the spot is `angle` off the axis.
double wall_under_a_spot(const std::string& spot, double* angle) {
  const auto file = probe_of(std::tan(*angle), 0);
  *angle = std::atan(
      std::stod(std::to_string(std::tan(*angle))));  // rounded like the digits in the file
  file->use_extension("KHR_lights_punctual");
  file->set("/extensions/KHR_lights_punctual/lights",
            R"([{"type": "spot", "intensity": 1, "spot": )" + spot + "}]");
  file->add_node(R"({"translation": [0, 0, 1],
                     "extensions": {"KHR_lights_punctual": {"light": 0}}})");
  TriangleMesh wall = unit_quad(file->add_material(kWhiteLambert));
  for (Vec3f& p : wall.positions) p = p * 16.0f - Vec3f{7, 9, 0};
  file->add_node_with_mesh(file->add_mesh(wall));
  return seen(*file, probe_settings()).x;
}

TEST(GltfSpot, FallsOffBetweenCones) {
  struct Cones {
    double inner, outer;
    std::string spot;
  };
  const auto cones = [](double inner, double outer) {
    return Cones{
        inner, outer,
        R"({"innerConeAngle": )" + text(inner) + R"(, "outerConeAngle": )" + text(outer) + "}"};
  };
  const Cones all[] = {cones(0.3, 0.6),    {0, std::numbers::pi / 4, "{}"}, cones(0, 0.1),
                       cones(0.2, 0.2004), cones(1, std::numbers::pi / 2),  cones(0.009, 0.01),
                       cones(0.02, 0.02)};
  for (const Cones& c : all) {
    const double width = c.outer - c.inner;
    // Positions up to 9 m away are precise to 5e-7 m, cosines to 1.2e-7; the squared ramp magnifies
    // both errors.
    const double ramp = width > 0 ? 1 / (std::cos(c.inner) - std::cos(c.outer)) : 0;
    const double tolerance = (2e-6 + 2 * (5e-7 + 1.2e-7) * ramp) / std::numbers::pi;
    double middle = 0.9 * c.inner;
    EXPECT_NEAR(wall_under_a_spot(c.spot, &middle),
                std::pow(std::cos(middle), 3) / std::numbers::pi, 2e-6)
        << c.spot << " inside";
    for (const double step : {-0.5, -0.01, 0.0, 0.01, 0.25, 0.5, 0.75, 0.99, 1.0}) {
      double angle = c.inner + step * width;
      if (angle < 0 || angle > 1.4 || !(width > 0)) continue;
      const double got = wall_under_a_spot(c.spot, &angle);
      const double cosine = std::cos(angle);  // also at the wall; the distance is 1 / cosine
      EXPECT_NEAR(got,
                  spot_share(angle, c.inner, c.outer) * cosine * cosine * cosine / std::numbers::pi,
                  tolerance)
          << c.spot << " at " << angle;
    }
    double outside = c.outer + 0.01;
    if (outside > 1.4) continue;
    EXPECT_EQ(wall_under_a_spot(c.spot, &outside), 0) << c.spot;
  }
}

/// The brightest pixel of `file` at frame n of 24 a second.
contract::GridPoint brightest(const GltfBuilder& file, std::int32_t frame, std::int32_t width,
                              std::int32_t height) {
  contract::RenderSettings settings = small_settings(width, height, 16);
  settings.max_depth = 1;
  auto scene = load_and_pose(file, settings, frame);
  EXPECT_TRUE(scene.ok()) << scene.status();
  contract::GridPoint best{-1, -1};
  if (!scene.ok()) return best;
  const Picture picture = render_picture(*std::move(scene), settings);
  double largest = 0;
  for (std::int32_t y = 0; y < height; ++y) {
    for (std::int32_t x = 0; x < width; ++x) {
      if (!(picture.at(x, y).x > largest)) continue;
      largest = picture.at(x, y).x;
      best = {x, y};
    }
  }
  return best;
}

Vec3d turned_about_x(double angle, const Vec3d& v) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {v.x, c * v.y - s * v.z, s * v.y + c * v.z};
}
Vec3d turned_about_y(double angle, const Vec3d& v) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x + s * v.z, v.y, -s * v.x + c * v.z};
}

constexpr double kTilt = -0.35;                  // of the camera on its arm, about x
constexpr Vec3d kArm{0.5, 1, 0.25};              // where it is there
constexpr Vec3d kFrom{-2, 0, 1}, kTo{4, 3, -1};  // where the arm is at 0 s and 2 s

/// World position of the point `local` of camera space at `seconds`: the arm moves in a straight
/// line and turns a quarter about y, at constant speed, for 2 s.
Vec3d world_at(double seconds, const Vec3d& local) {
  const double share = std::min(std::max(seconds / 2, 0.0), 1.0);
  const Vec3d on_arm = kArm + turned_about_x(kTilt, local);
  return kFrom + (kTo - kFrom) * share + turned_about_y(std::numbers::pi / 2 * share, on_arm);
}

/// A file with a camera on that animated arm, and a small lamp at `lamp`.
std::unique_ptr<GltfBuilder> filmed(const std::string& camera, const Vec3d& lamp) {
  auto file = std::make_unique<GltfBuilder>();
  file->add("cameras", camera);
  file->add_node(R"({"children": [1]})");
  file->add_node(R"({"camera": 0, "translation": )" + text(kArm) + R"(, "rotation": [)" +
                     text(std::sin(kTilt / 2)) + ", 0, 0, " + text(std::cos(kTilt / 2)) + "]}",
                 false);
  const int times = file->add_floats("SCALAR", {0, 2});
  const int places = file->add_vec3({Vec3f(kFrom), Vec3f(kTo)});
  const auto half = static_cast<float>(std::sqrt(0.5));
  const int turns = file->add_vec4({{0, 0, 0, 1}, {0, half, 0, half}});
  const auto sampler = [&](int output) {
    return R"({"input": )" + std::to_string(times) + R"(, "output": )" + std::to_string(output) +
           "}";
  };
  file->add("animations", R"({"samplers": [)" + sampler(places) + ", " + sampler(turns) +
                              R"(], "channels": [
      {"sampler": 0, "target": {"node": 0, "path": "translation"}},
      {"sampler": 1, "target": {"node": 0, "path": "rotation"}}]})");
  TriangleMesh ball;  // an octahedron
  for (const float s : {-0.02f, 0.02f}) {
    ball.positions.insert(ball.positions.end(), {{s, 0, 0}, {0, s, 0}, {0, 0, s}});
  }
  ball.indices = {3, 4, 5, 4, 0, 5, 0, 1, 5, 1, 3, 5, 4, 3, 2, 0, 4, 2, 1, 0, 2, 3, 1, 2};
  ball.material = file->add_material(R"({"emissiveFactor": [1, 1, 1]})");
  file->add_node_with_mesh(file->add_mesh(ball), R"({"translation": )" + text(lamp) + "}");
  return file;
}

TEST(GltfCamera, FollowsAnimatedNode) {
  constexpr std::int32_t kWidth = 96, kHeight = 64;
  constexpr double kDistance = 5, kYfov = 0.7, kYmag = 2;
  const std::string perspective =
      R"({"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01, "zfar": 100}})";
  const std::string orthographic =
      R"({"type": "orthographic", "orthographic":
          {"xmag": 2, "ymag": 2, "znear": 0.01, "zfar": 100}})";
  struct Shot {
    std::int32_t frame;
    contract::GridPoint pixel;
  };
  for (const Shot& shot : {Shot{0, {10, 50}},
                           {7, {80, 3}},
                           {24, {47, 31}},
                           {41, {5, 5}},
                           {48, {90, 60}},
                           {1000, {30, 20}},
                           {-5, {60, 40}}}) {
    for (const bool flat : {false, true}) {
      // Half the image height in metres at the lamp.
      const double reach = flat ? kYmag : kDistance * std::tan(kYfov / 2);
      const double scale = reach / (kHeight / 2.0);
      const Vec3d local{(shot.pixel.x + 0.5 - kWidth / 2.0) * scale,
                        (kHeight / 2.0 - shot.pixel.y - 0.5) * scale, -kDistance};
      const auto file =
          filmed(flat ? orthographic : perspective, world_at(shot.frame / 24.0, local));
      EXPECT_EQ(brightest(*file, shot.frame, kWidth, kHeight), shot.pixel)
          << "frame " << shot.frame << (flat ? " orthographic" : " perspective");
    }
  }
}

/// Returns whether the mesh that `build` adds covers the spot (x, y) of an otherwise black image.
template <typename Build>
bool is_covered(double x, double y, const Build& build) {
  const auto file = probe_of(x, y);
  const int material = file->add_material(R"({"extensions": {"KHR_materials_unlit": {}}})");
  build(*file, material);
  contract::RenderSettings settings = probe_settings();
  settings.background = contract::Background::color;
  return seen(*file, settings).x == 1;
}

TEST(GltfNodes, GpuInstancesUseTheirAttributes) {
  const auto covered = [](double x, double y, bool instanced) {
    return is_covered(x, y, [&](GltfBuilder& file, int material) {
      const int places = file.add_vec3({{2, 0, 0}, {0, 3, 0}});
      const int node = file.add_node_with_mesh(file.add_mesh(unit_quad(material)));
      if (!instanced) return;
      file.use_extension("EXT_mesh_gpu_instancing", true);
      file.set("/nodes/" + std::to_string(node) +
                   "/extensions/EXT_mesh_gpu_instancing/attributes/TRANSLATION",
               std::to_string(places));
    });
  };
  EXPECT_TRUE(covered(0.3, 0.6, false));
  EXPECT_FALSE(covered(2.3, 0.6, false));
  EXPECT_FALSE(covered(0.3, 0.6, true));
  EXPECT_TRUE(covered(2.3, 0.6, true));
  EXPECT_TRUE(covered(0.3, 3.6, true));
}

TEST(GltfNodes, InvisibleNodesAreNotRendered) {
  for (const bool visible : {true, false}) {
    EXPECT_EQ(visible, is_covered(0.3, 0.6, [&](GltfBuilder& file, int material) {
                file.use_extension("KHR_node_visibility");
                file.add_node_with_mesh(file.add_mesh(unit_quad(material)),
                                        std::string(R"({"extensions": {"KHR_node_visibility":
                                                        {"visible": )") +
                                            (visible ? "true}}}" : "false}}}"));
              }));
  }
}

TEST(GltfMeshes, QuantizedPositionsKeepTheirExtent) {
  // Normalised byte codes 0 and 51 are 0 and 0.2; the node scales them to 0 and 1.
  const auto covered = [](double x, double y) {
    return is_covered(x, y, [](GltfBuilder& file, int material) {
      file.use_extension("KHR_mesh_quantization", true);
      const std::vector<std::uint8_t> codes = {0, 0, 0, 0, 51, 0, 0, 0, 51, 51, 0, 0, 0, 51, 0, 0};
      TriangleMesh quad = unit_quad(material);
      const int mesh = file.add_mesh(quad);
      const int positions = file.add_accessor({.view = file.add_view(bytes_of(codes), 4),
                                               .component_type = kUnsignedByte,
                                               .count = 4,
                                               .type = "VEC3",
                                               .normalized = true});
      file.set("/meshes/0/primitives/0/attributes/POSITION", std::to_string(positions));
      file.add_node_with_mesh(mesh, R"({"scale": [5, 5, 5]})");
    });
  };
  EXPECT_TRUE(covered(0.999, 0.5));
  EXPECT_FALSE(covered(1.001, 0.5));
  EXPECT_TRUE(covered(0.25, 0.001));
  EXPECT_FALSE(covered(0.25, -0.001));
}

}  // namespace
}  // namespace tessera::testing
