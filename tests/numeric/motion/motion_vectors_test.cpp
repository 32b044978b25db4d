/// Motion vectors: pixels to where a surface is one frame earlier and one frame later.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <optional>

#include "tests/numeric/motion/average_of_sharp.h"
#include "tests/numeric/motion/motion_files.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/render/frame_renderer.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::GltfBuilder;
using tessera::testing::load_and_pose;

/// Pixels of a metre on the plane z = 0, 5 m in front of add_camera().
const double kPixelsPerMetre = 0.5 / (5 * std::tan(0.0125));
constexpr std::int32_t kWidth = 24;

/// The motion of the pixels of frame 1 at two frames per second; nullopt if it cannot be rendered.
std::optional<std::vector<float>> rendered_motion(const GltfBuilder& file,
                                                  std::uint32_t aovs = contract::kAovMotion) {
  contract::RenderSettings settings = all_animations();
  settings.fps = 2;
  settings.aovs = aovs;
  auto scene = load_and_pose(file, settings, 1);
  EXPECT_TRUE(scene.ok()) << scene.status();
  if (!scene.ok()) return std::nullopt;
  const auto renderer = FrameRenderer::create(*std::move(scene), settings, 1, sequential());
  EXPECT_TRUE(renderer.ok()) << renderer.status();
  if (!renderer.ok()) return std::nullopt;
  return (*renderer)->render({0, 0, kWidth, 1}, {0, 4}, 0, sequential()).motion;
}

/// Expects the motion of the pixel in the middle.
void expect_motion(const GltfBuilder& file, const std::array<double, 4>& expected) {
  const auto motion = rendered_motion(file);
  ASSERT_TRUE(motion && motion->size() == 4 * kWidth);
  for (std::size_t k = 0; k < 4; ++k)
    EXPECT_NEAR((*motion)[4 * (kWidth / 2) + k], expected[k], 1e-4) << k;
}

TEST(MotionVectors, FollowMovingNode) {
  GltfBuilder b;
  add_camera(b, 0, 0);
  const int node = b.add_node_with_mesh(add_stripe(b, -1, 2, shining(b, "[1, 1, 1]")));
  animate(b, node, "translation", {0, 0.5f, 1}, "VEC3", {-0.25f, 0, 0, 0, 0, 0, 0.125f, 0.5f, 0});
  expect_motion(b, {-0.25 * kPixelsPerMetre, 0, 0.125 * kPixelsPerMetre, 0.5 * kPixelsPerMetre});
}

TEST(MotionVectors, FollowCamera) {
  GltfBuilder b;
  const int camera = add_camera(b, 0, 0);
  animate(b, camera, "translation", {0, 0.5f, 1}, "VEC3", {0, 0, 5, 0.25f, 0, 5, 0.75f, 0.25f, 5});
  b.add_node_with_mesh(add_stripe(b, -2, 4, shining(b, "[1, 1, 1]")));
  expect_motion(b, {0.25 * kPixelsPerMetre, 0, -0.5 * kPixelsPerMetre, -0.25 * kPixelsPerMetre});
}

TEST(MotionVectors, FollowMorphTargets) {
  GltfBuilder b;
  add_camera(b, 0, 0);
  const int mesh = add_stripe(b, -1, 2, shining(b, "[1, 1, 1]"));
  const int moves = b.add_vec3({{0.5f, 0, 0}, {0.5f, 0, 0}, {0.5f, 0, 0}, {0.5f, 0, 0}});
  b.set("/meshes/" + number(mesh) + "/primitives/0/targets",
        R"([{"POSITION": )" + number(moves) + "}]");
  animate(b, b.add_node_with_mesh(mesh), "weights", {0, 1}, "SCALAR", {0, 1});
  expect_motion(b, {-0.25 * kPixelsPerMetre, 0, 0.25 * kPixelsPerMetre, 0});
}

TEST(MotionVectors, FollowSkin) {
  GltfBuilder b;
  add_camera(b, 0, 0);
  const int mesh = add_stripe(b, -1, 2, shining(b, "[1, 1, 1]"));
  tessera::testing::AccessorSpec spec;
  spec.view = b.add_view(tessera::testing::bytes_of(std::vector<std::uint8_t>(16, 0)));
  spec.component_type = tessera::testing::kUnsignedByte;
  spec.count = 4;
  spec.type = "VEC4";
  b.set("/meshes/" + number(mesh) + "/primitives/0/attributes/JOINTS_0",
        number(b.add_accessor(spec)));
  b.set("/meshes/" + number(mesh) + "/primitives/0/attributes/WEIGHTS_0",
        number(b.add_vec4({{1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}})));
  const int joint = b.add_node("{}");
  animate(b, joint, "translation", {0, 1}, "VEC3", {-0.25f, 0, 0, 0.25f, 0, 0});
  b.add("skins", R"({"joints": [)" + number(joint) + "]}");
  b.add_node_with_mesh(mesh, R"({"skin": 0})");
  expect_motion(b, {-0.25 * kPixelsPerMetre, 0, 0.25 * kPixelsPerMetre, 0});
}

/// During the exposure the mesh moves; the vectors are those between the times of the frames.
TEST(MotionVectors, ShutterDoesNotMatter) {
  GltfBuilder b;
  add_camera(b, -0.2, 0.2);
  const int node = b.add_node_with_mesh(add_stripe(b, -1, 2, shining(b, "[1, 1, 1]")));
  animate(b, node, "translation", {0, 1}, "VEC3", {-0.25f, 0, 0, 0.25f, 0, 0});
  expect_motion(b, {-0.25 * kPixelsPerMetre, 0, 0.25 * kPixelsPerMetre, 0});
}

TEST(MotionVectors, StillSceneHasNone) {
  GltfBuilder b;
  add_camera(b, 0, 0);
  b.add_node_with_mesh(add_stripe(b, -0.7f, 1.4f, shining(b, "[1, 1, 1]")));
  const auto motion = rendered_motion(b);
  ASSERT_TRUE(motion);
  EXPECT_EQ(*motion, std::vector<float>(4 * kWidth));
}

TEST(MotionVectors, AreRenderedOnDemandOnly) {
  GltfBuilder b;
  add_camera(b, 0, 0);
  b.add_node_with_mesh(add_stripe(b, -1, 2, shining(b, "[1, 1, 1]")));
  const auto motion = rendered_motion(b, contract::kAovDepth);
  ASSERT_TRUE(motion);
  EXPECT_TRUE(motion->empty());
}

}  // namespace
}  // namespace tessera::render::testing
