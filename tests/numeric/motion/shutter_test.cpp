/// Keyframes within the shutter interval follow the file's animations.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "tests/numeric/motion/motion_files.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/accelerators/structure_accelerator.h"
#include "worker/geometry/motion.h"
#include "worker/gltf/build/loader.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::GltfBuilder;
using tessera::testing::load_and_pose;
using tessera::testing::render_picture;

/// A ball of radius 0.1 moves half round the z axis at a distance of 1 m.
TEST(MotionBounds, OrbitingBallIsHitAtItsTop) {
  GltfBuilder file;
  add_camera(file, 0, 1);
  file.use_extension("TESSERA_shape");
  const int ball = file.add_node(
      R"({"translation": [1, 0, 0], "extensions": {"TESSERA_shape": {"type": "sphere", "radius": 0.1}}})",
      false);
  const Primitive sphere = uv_sphere(8, 12, 0.1f);
  tessera::testing::TriangleMesh triangles;
  triangles.positions = sphere.positions;
  for (const auto& t : sphere.triangles) {
    triangles.indices.insert(triangles.indices.end(), t.begin(), t.end());
  }
  const int mesh = file.add_node(
      R"({"translation": [1, 0, 1], "mesh": )" + number(file.add_mesh(triangles)) + "}", false);
  const int arm = file.add_node(R"({"children": [)" + number(ball) + ", " + number(mesh) + "]}");
  const auto half = static_cast<float>(std::sin(std::numbers::pi / 2));
  animate(file, arm, "rotation", {0, 1}, "VEC4", {0, 0, 0, 1, 0, 0, half, 0});
  const auto scene = load_and_pose(file, all_animations());
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->motions.size(), 2u);
  const SceneAccel accel(*scene, in_order());
  const accelerators::StructureAccelerator other(*scene, accelerators::structures().front());
  for (const float time : {0.0f, 0.125f, 0.5f, 0.8125f, 1.0f}) {
    const double angle = std::numbers::pi * static_cast<double>(time);
    for (const double z : {0.0, 1.0}) {
      // Rays from 0.15 above the ball's centre towards it.
      const Vec3d out = {std::cos(angle), std::sin(angle), 0};
      Ray ray;
      ray.origin = Vec3f(out * 1.15 + Vec3d{0, 0, z} - scene->center);
      ray.direction = Vec3f(-out);
      ray.time = time;
      Hit hit, same;
      ASSERT_TRUE(accel.closest_hit(ray, hit)) << time << " " << z;
      ASSERT_TRUE(other.closest_hit(ray, nullptr, same));
      EXPECT_TRUE(same_bits(hit, same));
      // The tolerance of add_motion() is 2^-10 of the ball's box, whose diagonal is 0.35 m, times
      // 4/3; the mesh is within 0.1 (1 - cos(pi / 8)^2) of the ball.
      EXPECT_NEAR(hit.t, 0.05f, z == 0 ? 0.00047 : 0.015) << time;
      // At other times the ball is elsewhere.
      ray.time = time < 0.5f ? time + 0.25f : time - 0.25f;
      EXPECT_FALSE(accel.closest_hit(ray, hit) && hit.t < 0.1f);
    }
  }
}

/// S curves and static objects: keys are only where they are needed.
TEST(Shutter, KeysAreAddedOnlyWherePathsBend) {
  const auto keys = [](const char* interpolation, const std::vector<float>& times,
                       const std::vector<float>& values, double open, double close) {
    GltfBuilder file;
    add_camera(file, open, close);
    const int node = file.add_node_with_mesh(file.add_mesh(tessera::testing::unit_quad()));
    animate(file, node, "translation", times, "VEC3", values, interpolation);
    const auto scene = load_and_pose(file, all_animations());
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene.ok() ? scene->key_times : std::vector<float>{-1};
  };
  using Times = std::vector<float>;
  EXPECT_EQ(keys("LINEAR", {0, 1}, {0, 0, 0, 1, 0, 0}, 0, 0.5), (Times{0, 1}));
  EXPECT_EQ(keys("LINEAR", {0, 1}, {0, 0, 0, 1, 0, 0}, 0.5, 0.5), Times{});
  EXPECT_EQ(keys("LINEAR", {0, 1}, {0, 0, 0, 0, 0, 0}, 0, 0.5), Times{});
  EXPECT_EQ(keys("LINEAR", {1, 2}, {0, 0, 0, 1, 0, 0}, 0, 0.5), Times{});
  EXPECT_EQ(keys("LINEAR", {0, 0.25f, 1}, {0, 0, 0, 1, 0, 0, 0, 1, 0}, 0, 0.5),
            (Times{0, 0.5f, 1}));
  // From (0, 0, 0) to (1, 0, 0) with zero speed at both ends: at half time it lies on the straight
  // line.
  const Times curve =
      keys("CUBICSPLINE", {0, 1}, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0}, 0, 1);
  EXPECT_GT(curve.size(), 8u);
  EXPECT_LT(curve.size(), 40u);
  const Times jump = keys("STEP", {0, 0.3f}, {0, 0, 0, 1, 0, 0}, 0, 0.5);
  ASSERT_EQ(jump.size(), 4u);
  EXPECT_EQ(jump[2] - jump[1], 0x1p-24f);
  EXPECT_NEAR(jump[2], 0.6, 1e-6);
}

TEST(Shutter, TurningPlaneNeedsFewKeys) {
  GltfBuilder file;
  add_camera(file, 0, 1);
  file.use_extension("TESSERA_shape");
  const int node = file.add_node(R"({"extensions": {"TESSERA_shape": {"type": "plane"}}})");
  animate(file, node, "rotation", {0, 1}, "VEC4", {0, 0, 0, 1, 0, 0, 0.1f, 0.995f});
  const auto scene = load_and_pose(file, all_animations());
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_GT(scene->key_times.size(), 2u);
  EXPECT_LT(scene->key_times.size(), 10u);
}

TEST(Shutter, StepAnimationDoesNotSmear) {
  GltfBuilder file;
  add_camera(file, 0, 1);
  const int node = file.add_node_with_mesh(file.add_mesh(tessera::testing::unit_quad()));
  animate(file, node, "translation", {0, 0.3f}, "VEC3", {0, 0, 0, 4, 0, 0}, "STEP");
  const auto scene = load_and_pose(file, all_animations());
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->motions.size(), 1u);
  for (std::uint32_t k = 0; k <= 0x1000; ++k) {
    const float time = static_cast<float>(k) / 0x1000;
    const auto pose = pose_at(scene->motions[0], find_key(scene->key_times, time));
    ASSERT_TRUE(pose.has_value());
    EXPECT_EQ(pose->object_to_world.translation.x + scene->center.x, time < 0.3f ? 0 : 4) << time;
  }
}

TEST(Shutter, StaticSceneIsUnchanged) {
  GltfBuilder open, closed;
  for (GltfBuilder* file : {&open, &closed}) {
    add_camera(*file, 0, file == &open ? 1 : 0);
    file->add_node_with_mesh(file->add_mesh(tessera::testing::unit_quad()));
    const int far = file->add_node(R"({})");
    animate(*file, far, "translation", {0, 1}, "VEC3", {0, 0, 0, 4, 0, 0});
  }
  auto settings = all_animations();
  const auto a = load_and_pose(open, settings), b = load_and_pose(closed, settings);
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_TRUE(a->key_times.empty() && a->camera.keys.empty());
  EXPECT_EQ(render_picture(*a, settings).rgb, render_picture(*b, settings).rgb);
}

/// A hidden object that swings needs no keys.
TEST(Shutter, ObjectOfScaleZeroChangesNothing) {
  GltfBuilder plain, hidden;
  for (GltfBuilder* file : {&plain, &hidden}) {
    add_camera(*file, 0, 1);
    const int mesh = file->add_mesh(tessera::testing::unit_quad());
    const int moves = file->add_node_with_mesh(mesh);
    animate(*file, moves, "translation", {0, 1}, "VEC3", {0, 0, 0, 4, 0, 0});
    std::string node = R"({"name": "none"})";
    if (file == &hidden) node = R"({"scale": [0, 0, 0], "mesh": )" + number(mesh) + "}";
    const int swings = file->add_node(node);
    animate(*file, swings, "translation", {0, 1}, "VEC3",
            {0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 3, 0, 1, 0, 0, 0, 0, 0}, "CUBICSPLINE");
  }
  const auto settings = all_animations();
  tessera::testing::MemoryReader reader;
  reader.put("hidden.gltf", hidden.gltf());
  const auto file = load_scene_file("hidden.gltf", settings, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  const auto a = load_and_pose(plain, settings), b = (*file)->pose(settings, 0);
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(b->instances.size(), 1u);
  EXPECT_EQ(b->key_times, a->key_times);
  EXPECT_EQ(b->motions, a->motions);
  const auto& problems = (*file)->problems();
  EXPECT_TRUE(std::any_of(problems.begin(), problems.end(), [](const Problem& problem) {
    return problem.message == "its transform is singular; skipped";
  }));
}

/// A clip that shows an object by a scale that jumps.
TEST(Shutter, ObjectThatAppearsIsHitOnlyThen) {
  GltfBuilder file;
  add_camera(file, 0, 1);
  const int node = file.add_node_with_mesh(file.add_mesh(tessera::testing::unit_quad()));
  animate(file, node, "scale", {0, 0.25f, 0.5f}, "VEC3", {0, 0, 0, 1, 1, 1, 0, 0, 0}, "STEP");
  const auto scene = load_and_pose(file, all_animations());
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->instances.size(), 1u);
  EXPECT_TRUE(scene->instances[0].flat);
  const SceneAccel accel(*scene, in_order());
  for (std::uint32_t k = 0; k <= 0x100; ++k) {
    Ray ray;
    ray.origin = Vec3f(Vec3d{0.5, 0.25, 1} - scene->center);
    ray.direction = {0, 0, -1};
    ray.time = static_cast<float>(k) / 0x100;
    EXPECT_EQ(accel.any_hit(ray), ray.time >= 0.25f && ray.time < 0.5f) << ray.time;
  }
}

TEST(Shutter, MeshesWithDifferentMotionAreSplit) {
  GltfBuilder file;
  add_camera(file, 0, 1);
  tessera::testing::TriangleMesh quad = tessera::testing::unit_quad();
  const int mesh = file.add_mesh(quad);
  const int moves = file.add_vec3({{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}});
  file.set("/meshes/0/primitives/0/targets", R"([{"POSITION": )" + number(moves) + "}]");
  const int still = file.add_node_with_mesh(mesh), up = file.add_node_with_mesh(mesh),
            down = file.add_node_with_mesh(mesh);
  animate(file, up, "weights", {0, 1}, "SCALAR", {0, 1});
  animate(file, down, "weights", {0, 1}, "SCALAR", {0, -1});
  const auto scene = load_and_pose(file, all_animations());
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->instances.size(), 3u);
  for (const Instance& instance : scene->instances) {
    const Mesh& own = scene->meshes[static_cast<std::size_t>(instance.mesh)];
    ASSERT_EQ(own.keys.size(), instance.node == still ? 0u : 2u);
    if (own.keys.empty()) continue;
    EXPECT_EQ(own.keys[1][0].positions[0].z, instance.node == up ? 1 : -1);
    EXPECT_TRUE(own.keys[1][0].triangles.empty());
  }
}

}  // namespace
}  // namespace tessera::render::testing
