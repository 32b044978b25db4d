#include <gtest/gtest.h>

#include <string>

#include "tests/support/scene/plain_scene.h"
#include "worker/render/frame_renderer.h"
#include "worker/scene/features.h"

namespace tessera::testing {
namespace {

using render::Scene;

/// Two spheres of 7,000 triangles, one instanced twice.
Scene balls(const render::Material& material) {
  Scene scene = empty_scene();
  const auto index = add_material(&scene, material);
  add_primitive(&scene, sphere({0, 0, 0}, 1, 84, index));
  add_primitive(&scene, sphere({3, 0, 0}, 1, 84, index));
  render::Instance again = scene.instances[0];
  again.object_to_world = translation(0, 4, 0);
  again.world_to_object = translation(0, -4, 0);
  scene.instances.push_back(again);
  return scene;
}

render::Material lamp() {
  render::Material material = lambert({0.5f, 0.5f, 0.5f});
  material.emission = {1, 1, 1};
  return material;
}

/// Compares the estimate with the memory that the renderer reports. Building takes up to twice as
/// much temporarily; lights, which pass through more forms, up to ten times.
void expect_near_actual_memory(Scene scene, double most) {
  const render::SceneFeatures features = features_of(scene);
  const std::int64_t estimate = features.total_bytes() - render::kProcessBytes;
  const auto made = render::FrameRenderer::create(std::move(scene), small_settings(8, 8, 4), 0,
                                                  render::sequential());
  ASSERT_TRUE(made.ok()) << made.status();
  const auto kept = static_cast<double>((*made)->timings().memory_bytes);
  EXPECT_GE(static_cast<double>(estimate), 0.9 * kept);
  EXPECT_LE(static_cast<double>(estimate), most * kept);
}

TEST(MemoryEstimate, TreesScaleWithTriangles) {
  expect_near_actual_memory(balls(lambert({1, 1, 1})), 3);
  EXPECT_EQ(features_of(balls(lambert({1, 1, 1}))).light_bytes, 0);
}

TEST(MemoryEstimate, LightsScaleWithEmissiveInstances) {
  Scene scene = balls(lamp());
  const std::int64_t three = features_of(scene).light_bytes;
  expect_near_actual_memory(scene, 10);
  scene.instances.pop_back();
  EXPECT_EQ(3 * features_of(scene).light_bytes, 2 * three);
}

TEST(MemoryEstimate, EmissiveTexelsAreCounted) {
  Scene scene = balls(lamp());
  const render::SceneFeatures plain = features_of(scene);
  render::Image image;
  image.width = 512;
  image.height = 256;
  image.channels = 4;
  image.u8 = std::vector<std::uint8_t>(512 * 256 * 4, 200);
  scene.images.push_back(image);
  scene.textures.push_back({0, render::Wrap::repeat, render::Wrap::repeat, false});
  scene.materials[1].emissive_texture.texture = 0;
  const render::SceneFeatures textured = features_of(scene);
  EXPECT_EQ(textured.image_bytes, 512 * 256 * 4);
  // A double sum and a count per texel while the lights are gathered.
  EXPECT_EQ(textured.light_bytes - plain.light_bytes, 512 * 256 * (8 + 4));

  set_sky(&scene, 128, 64, std::vector<float>(128 * 64 * 3, 1.0f));
  EXPECT_EQ(features_of(scene).light_bytes - textured.light_bytes, 128 * 64 * 8);
  expect_near_actual_memory(scene, 10);
}

}  // namespace
}  // namespace tessera::testing
