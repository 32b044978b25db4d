#include "worker/gltf/animation/animation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"

namespace tessera::render {
namespace {

using testing::bytes_of;
using testing::GltfBuilder;
using testing::load_and_pose;
using testing::unit_quad;

/// A quad on node 0 whose `path` is animated with the given keys at 0 s, 1 s and 3 s.
GltfBuilder& add_channel(GltfBuilder& b, const std::string& path, const char* type,
                         const std::vector<float>& values, const std::string& interpolation) {
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  const int input = b.add_floats("SCALAR", {0, 1, 3});
  const int output = b.add_floats(type, values);
  b.add("animations", R"({"name": "move", "samplers": [{"input": )" + std::to_string(input) +
                          R"(, "output": )" + std::to_string(output) + R"(, "interpolation": ")" +
                          interpolation +
                          R"("}], "channels": [{"sampler": 0, "target": {"node": 0, "path": ")" +
                          path + R"("}}]})");
  return b;
}

/// World position of the quad's corner (1, 1, 0) in frame n at 10 frames a second.
Vec3d corner_at(const GltfBuilder& b, int frame) {
  contract::RenderSettings settings;
  settings.fps = 10;
  const auto scene = load_and_pose(b, settings, frame);
  EXPECT_TRUE(scene.ok()) << scene.status();
  if (!scene.ok()) return {};
  return transform_point(scene->instances.at(0).object_to_world, Vec3d{1, 1, 0}) + scene->center;
}

void expect_near(const Vec3d& a, const Vec3d& b, double tolerance = 1e-6) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

TEST(Animation, TranslationIsLinearAndClamped) {
  GltfBuilder b;
  add_channel(b, "translation", "VEC3", {0, 0, 0, 4, 0, 0, 4, 8, 0}, "LINEAR");
  expect_near(corner_at(b, 0), {1, 1, 0});
  expect_near(corner_at(b, 5), {3, 1, 0});
  expect_near(corner_at(b, 10), {5, 1, 0});
  expect_near(corner_at(b, 25), {5, 7, 0});
  expect_near(corner_at(b, 900), {5, 9, 0});
  expect_near(corner_at(b, -20), {1, 1, 0});
}

TEST(Animation, StepHoldsKeyUntilNext) {
  GltfBuilder b;
  add_channel(b, "translation", "VEC3", {0, 0, 0, 4, 0, 0, 4, 8, 0}, "STEP");
  expect_near(corner_at(b, 9), {1, 1, 0});
  expect_near(corner_at(b, 10), {5, 1, 0});
  expect_near(corner_at(b, 29), {5, 1, 0});
  expect_near(corner_at(b, 30), {5, 9, 0});
}

TEST(Animation, CubicSplineMatchesHermite) {
  // In-tangent, value and out-tangent per key; only x moves.
  const std::vector<float> keys = {0, 0, 0, 0, 0, 0, 2, 0, 0, -1, 0, 0, 3, 0,
                                   0, 5, 0, 0, 1, 0, 0, 7, 0, 0,  0, 0, 0};
  GltfBuilder b;
  add_channel(b, "translation", "VEC3", keys, "CUBICSPLINE");
  const auto hermite = [](double p0, double m0, double p1, double m1, double s, double span) {
    const double s2 = s * s, s3 = s2 * s;
    return (2 * s3 - 3 * s2 + 1) * p0 + span * (s3 - 2 * s2 + s) * m0 + (-2 * s3 + 3 * s2) * p1 +
           span * (s3 - s2) * m1;
  };
  expect_near(corner_at(b, 3), {1 + hermite(0, 2, 3, -1, 0.3, 1), 1, 0});
  expect_near(corner_at(b, 10), {4, 1, 0});
  expect_near(corner_at(b, 15), {1 + hermite(3, 5, 7, 1, 0.25, 2), 1, 0});
  expect_near(corner_at(b, 30), {8, 1, 0});
}

TEST(Animation, RotationFollowsShorterArc) {
  // About z: 0, 90 degrees (given with the opposite sign), 180 degrees.
  const auto r = static_cast<float>(std::sqrt(0.5));
  GltfBuilder b;
  add_channel(b, "rotation", "VEC4", {0, 0, 0, 1, 0, 0, -r, -r, 0, 0, 1, 0}, "LINEAR");
  for (const int frame : {0, 3, 7, 10, 14, 26, 30}) {
    const double t = frame / 10.0;
    const double angle = t < 1 ? t * std::numbers::pi / 2
                               : std::numbers::pi / 2 + (t - 1) / 2 * std::numbers::pi / 2;
    const double c = std::cos(angle), s = std::sin(angle);
    expect_near(corner_at(b, frame), {c - s, s + c, 0}, 1e-6);
  }
}

TEST(Animation, RotationDecodesNormalisedShorts) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  const int input = b.add_floats("SCALAR", {0});
  const std::vector<std::int16_t> quaternion = {0, 0, 23170, 23170};
  const int output = b.add_accessor({.view = b.add_view(bytes_of(quaternion)),
                                     .component_type = testing::kShort,
                                     .count = 1,
                                     .type = "VEC4",
                                     .normalized = true});
  b.add("animations", R"({"samplers": [{"input": )" + std::to_string(input) + R"(, "output": )" +
                          std::to_string(output) +
                          R"(}], "channels": [{"sampler": 0, "target":
                          {"node": 0, "path": "rotation"}}]})");
  expect_near(corner_at(b, 0), {-1, 1, 0}, 1e-12);
}

TEST(Animation, ScaleReplacesNodeScale) {
  GltfBuilder b;
  add_channel(b, "scale", "VEC3", {1, 1, 1, 3, 5, 1, 3, 5, 1}, "LINEAR");
  b.set("/nodes/0/scale", "[100, 100, 100]");
  expect_near(corner_at(b, 5), {2, 3, 0});
}

TEST(Animation, IsSelectedByNameIndexAllOrNone) {
  GltfBuilder b;
  add_channel(b, "translation", "VEC3", {1, 0, 0, 1, 0, 0, 1, 0, 0}, "LINEAR");
  const int input = b.add_floats("SCALAR", {0});
  const int output = b.add_floats("VEC3", {2, 2, 2});
  b.add("animations", R"({"name": "grow", "samplers": [{"input": )" + std::to_string(input) +
                          R"(, "output": )" + std::to_string(output) +
                          R"(}], "channels": [{"sampler": 0, "target":
                          {"node": 0, "path": "scale"}}]})");
  contract::RenderSettings settings;
  const auto corner = [&](const char* animation) {
    settings.animation = animation;
    const auto scene = load_and_pose(b, settings);
    return transform_point(scene->instances.at(0).object_to_world, Vec3d{1, 1, 0}) + scene->center;
  };
  expect_near(corner(""), {2, 1, 0});
  expect_near(corner("move"), {2, 1, 0});
  expect_near(corner("grow"), {2, 2, 0});
  expect_near(corner("1"), {2, 2, 0});
  expect_near(corner("all"), {3, 2, 0});
  expect_near(corner("none"), {1, 1, 0});
  settings.animation = "dance";
  EXPECT_EQ(load_and_pose(b, settings).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(Slerp, MatchesLongDoubleFormula) {
  for (const double angle : {1e-9, 1e-5, 0.1, 1.0, 1.5707}) {
    for (const double f : {0.0, 0.2, 0.5, 0.9, 1.0}) {
      const Vec4d a = {0, 0, 0, 1};
      const Vec4d b = {0, 0, std::sin(angle), std::cos(angle)};
      const Vec4d q = slerp(a, b, f);
      EXPECT_NEAR(q.z, static_cast<double>(std::sin(static_cast<long double>(f) * angle)),
                  1e-15 + 4e-16 * angle);
      EXPECT_NEAR(q.w, std::cos(f * angle), 1e-15);
    }
  }
}

/// A morphing triangle: two targets, one with normals.
GltfBuilder& add_morphing_triangle(GltfBuilder& b) {
  b.add_vec3({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});  // 0
  b.add_vec3({{0, 0, 1}, {0, 0, 1}, {0, 0, 1}});  // 1: normals
  b.add_vec3({{1, 0, 0}, {0, 0, 0}, {0, 2, 0}});  // 2: moves
  b.add_vec3({{0, 0, 4}, {0, 0, 4}, {0, 0, 4}});  // 3
  b.add_vec3({{1, 0, 0}, {0, 0, 0}, {0, 0, 0}});  // 4: normal moves
  b.add("meshes", R"({"weights": [0.5, 0.25], "primitives": [
      {"attributes": {"POSITION": 0, "NORMAL": 1},
       "targets": [{"POSITION": 2}, {"POSITION": 3, "NORMAL": 4}]}]})");
  return b;
}

TEST(Morphing, AddsWeightedDisplacements) {
  GltfBuilder b;
  add_morphing_triangle(b);
  b.add_node_with_mesh(0);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& p = scene->meshes[0].primitives[0];
  EXPECT_EQ(p.positions[0], (Vec3f{0.5f, 0, 1}));
  EXPECT_EQ(p.positions[1], (Vec3f{1, 0, 1}));
  EXPECT_EQ(p.positions[2], (Vec3f{0, 2, 1}));
  const double length = std::sqrt(1 + 0.25 * 0.25);
  EXPECT_NEAR(p.normals[0].x, 0.25 / length, 1e-7);
  EXPECT_NEAR(p.normals[0].z, 1 / length, 1e-7);
  EXPECT_EQ(p.normals[1], (Vec3f{0, 0, 1}));
}

TEST(Morphing, NodeWeightsOverrideMeshWeights) {
  GltfBuilder b;
  add_morphing_triangle(b);
  b.add_node_with_mesh(0, R"({"weights": [0, 0]})");
  b.add_node_with_mesh(0);
  b.add_node_with_mesh(0, R"({"weights": [0, 0]})");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes.size(), 2u);
  EXPECT_EQ(scene->instances[0].mesh, scene->instances[2].mesh);
  EXPECT_EQ(scene->meshes[0].primitives[0].positions[0], (Vec3f{0, 0, 0}));
  EXPECT_EQ(scene->meshes[1].primitives[0].positions[0], (Vec3f{0.5f, 0, 1}));
}

TEST(Morphing, WeightsCanBeAnimated) {
  GltfBuilder b;
  add_morphing_triangle(b);
  b.add_node_with_mesh(0);
  const int input = b.add_floats("SCALAR", {0, 1});
  const int output = b.add_floats("SCALAR", {0, 0, 1, 0.5f});
  b.add("animations", R"({"samplers": [{"input": )" + std::to_string(input) + R"(, "output": )" +
                          std::to_string(output) +
                          R"(}], "channels": [{"sampler": 0, "target":
                          {"node": 0, "path": "weights"}}]})");
  contract::RenderSettings settings;
  settings.fps = 4;
  const auto scene = load_and_pose(b, settings, 1);  // t = 0.25: weights 0.25, 0.125
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes[0].primitives[0].positions[2], (Vec3f{0, 1.5f, 0.5f}));
}

/// An arm of two joints: vertices 0 and 1 follow the first, 2 the second, 3 both by 1/4 and 3/4;
/// with `second_set`, vertex 3 by JOINTS_1 and WEIGHTS_1. Tangents along x.
std::string skinned_arm(bool second_set = false) {
  GltfBuilder b;
  b.add_vec3({{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {1, 2, 0}});
  b.add_vec3({{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {1, 0, 0}});
  const std::vector<std::uint8_t> joints = {0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0};
  b.add_accessor({.view = b.add_view(bytes_of(joints)),
                  .component_type = testing::kUnsignedByte,
                  .count = 4,
                  .type = "VEC4"});
  b.add_vec4({{1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}, {0.25f, second_set ? 0 : 0.75f, 0, 0}});
  b.add_indices({0, 1, 2, 1, 3, 2});
  b.use_extension("KHR_materials_anisotropy");
  // The second joint's bind pose is at (0, 1, 0).
  b.add_floats("MAT4", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0,  0, 1,
                        1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1});
  b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1, "JOINTS_0": 2,
                                      "WEIGHTS_0": 3}, "indices": 4}]})");
  if (second_set) {
    const std::vector<std::uint8_t> more(16, 1);
    const int joint = b.add_accessor({.view = b.add_view(bytes_of(more)),
                                      .component_type = testing::kUnsignedByte,
                                      .count = 4,
                                      .type = "VEC4"});
    const int weight = b.add_vec4({{0, 0, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 0.75f}});
    b.set("/meshes/0/primitives/0/attributes/JOINTS_1", std::to_string(joint));
    b.set("/meshes/0/primitives/0/attributes/WEIGHTS_1", std::to_string(weight));
  }
  const int brushed = b.add_material(
      R"({"extensions": {"KHR_materials_anisotropy": {"anisotropyStrength": 0.5}}})");
  const int along = b.add_vec4({{1, 0, 0, 1}, {1, 0, 0, 1}, {1, 0, 0, 1}, {0, 1, 0, 1}});
  b.set("/meshes/0/primitives/0/material", std::to_string(brushed));
  b.set("/meshes/0/primitives/0/attributes/TANGENT", std::to_string(along));
  b.set("/meshes/0/primitives/0/attributes/TEXCOORD_0",
        std::to_string(b.add_vec2({{0, 0}, {1, 0}, {0, 1}, {1, 1}})));
  b.add("skins", R"({"joints": [1, 2], "inverseBindMatrices": 5})");
  b.add_node(R"({"mesh": 0, "skin": 0, "translation": [77, 77, 77]})");  // ignored for skins
  b.add_node(R"({"translation": [10, 0, 0], "children": [2]})");
  b.add_node(R"({"translation": [0, 1, 0],
                 "rotation": [0, 0, 0.7071067811865476, 0.7071067811865476]})",
             false);
  return b.gltf();
}

TEST(Skins, BlendingMatchesIndependentEvaluation) {
  const auto scene = load_and_pose(skinned_arm());
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& p = scene->meshes[0].primitives[0];
  const auto world = [&](std::size_t v) { return Vec3d(p.positions[v]) + scene->center; };
  // Joint 0 moves by (10, 0, 0). Joint 1 turns by 90 degrees about (0, 1) and moves the same.
  expect_near(world(0), {10, 0, 0});
  expect_near(world(1), {11, 0, 0});
  // (0, 2): 1 above the joint, turned to 1 left of it.
  expect_near(world(2), {9, 1, 0});
  // (1, 2): joint 0 gives (11, 2), joint 1 gives (10 - 1, 1 + 1) = (9, 2).
  expect_near(world(3), {0.25 * 11 + 0.75 * 9, 2, 0});
  // Normal (1, 0, 0) under M = 1/4 I + 3/4 R(90): inverse transpose of [[.25, -.75], [.75, .25]]
  // is M / det, so it points along M's first column.
  const double length = std::sqrt(0.25 * 0.25 + 0.75 * 0.75);
  expect_near(Vec3d(p.normals[3]), {0.25 / length, 0.75 / length, 0});
  EXPECT_EQ(scene->instances[0].object_to_world, Affine3d());
}

TEST(Skins, MirroringJointsFlipWinding) {
  std::string file = skinned_arm();
  const std::string joint = R"("translation":[10,0,0])";  // the first; the second is its child
  const std::size_t at = file.find(joint);
  ASSERT_NE(at, std::string::npos);
  const auto straight = load_and_pose(file);
  const auto mirrored = load_and_pose(file.insert(at, R"("scale":[-1,1,1],)"));
  ASSERT_TRUE(straight.ok() && mirrored.ok()) << mirrored.status();
  const Primitive &p = straight->meshes[0].primitives[0], &q = mirrored->meshes[0].primitives[0];
  for (std::size_t t = 0; t < 2; ++t) {
    EXPECT_EQ(q.triangles[t][1], p.triangles[t][2]);
    EXPECT_EQ(q.triangles[t][2], p.triangles[t][1]);
    // The front is the side of the normals, +z, which this mirror does not change.
    const Vec3f a = q.positions[q.triangles[t][0]];
    const Vec3f across =
        cross(q.positions[q.triangles[t][1]] - a, q.positions[q.triangles[t][2]] - a);
    EXPECT_GT(dot(across, q.normals[0]), 0);
  }
  EXPECT_FALSE(mirrored->instances[0].flips_winding);
  // The other tangent belongs to the mirrored texture: up, as before.
  ASSERT_EQ(q.tangents.size(), 4u);
  EXPECT_EQ(p.tangents[0], (Vec4f{1, 0, 0, 1}));
  EXPECT_EQ(q.tangents[0], (Vec4f{-1, 0, 0, -1}));
}

TEST(Skins, SecondInfluenceSetIsRead) {
  const auto four = load_and_pose(skinned_arm(false)), eight = load_and_pose(skinned_arm(true));
  ASSERT_TRUE(four.ok()) << four.status();
  ASSERT_TRUE(eight.ok()) << eight.status();
  const Primitive &p = four->meshes[0].primitives[0], &q = eight->meshes[0].primitives[0];
  for (std::size_t v = 0; v < 4; ++v) {
    expect_near(Vec3d(q.positions[v]) + eight->center, Vec3d(p.positions[v]) + four->center);
    expect_near(Vec3d(q.normals[v]), Vec3d(p.normals[v]));
  }
}

TEST(Skins, MissingJointsAndMatricesAreRejected) {
  std::string file = skinned_arm();
  const std::string joints = R"("joints":[1,2])";
  const std::size_t at = file.find(joints);
  ASSERT_NE(at, std::string::npos);
  file.replace(at, joints.size(), R"("joints":[1])");
  const auto scene = load_and_pose(file);
  EXPECT_EQ(scene.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(scene.status().message()).find("joint 1 of 1"), std::string::npos)
      << scene.status();
}

}  // namespace
}  // namespace tessera::render
