#include "worker/gltf/animation/pose_cache.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"

namespace tessera::render {
namespace {

using testing::bytes_of;
using testing::GltfBuilder;
using testing::MemoryReader;
using testing::unit_quad;

/// One black PNG texel.
const std::vector<std::uint8_t> black_png = {
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48,
    0x44, 0x52, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x08, 0x00, 0x00, 0x00,
    0x00, 0x3a, 0x7e, 0x9b, 0x55, 0x00, 0x00, 0x00, 0x0a, 0x49, 0x44, 0x41, 0x54, 0x78,
    0x9c, 0x63, 0x60, 0x00, 0x00, 0x00, 0x02, 0x00, 0x01, 0x48, 0xaf, 0xa4, 0x71, 0x00,
    0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};

/// Four quads in the second from 0 to 1: one textured and moving, one static, one morphed, one
/// skinned.
std::string moving_scene() {
  GltfBuilder b;
  const int image = b.add_image(bytes_of(black_png), "image/png");
  const int texture = b.add_texture(image);
  b.add_material(R"({"pbrMetallicRoughness": {"baseColorTexture": {"index": )" +
                 std::to_string(texture) + "}}}");
  const int plain = b.add_mesh(unit_quad(0));
  const int morphed = b.add_mesh(unit_quad());
  const int target = b.add_vec3({{0, 0, 1}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}});
  b.set("/meshes/" + std::to_string(morphed) + "/primitives/0/targets",
        R"([{"POSITION": )" + std::to_string(target) + "}]");
  const int bent = b.add_mesh(unit_quad());
  const std::vector<std::uint8_t> joints(16, 0);
  const int joint = b.add_accessor({.view = b.add_view(bytes_of(joints)),
                                    .component_type = testing::kUnsignedByte,
                                    .count = 4,
                                    .type = "VEC4"});
  const int weight = b.add_vec4({{1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}});
  const std::string attributes = "/meshes/" + std::to_string(bent) + "/primitives/0/attributes/";
  b.set(attributes + "JOINTS_0", std::to_string(joint));
  b.set(attributes + "WEIGHTS_0", std::to_string(weight));
  b.add_node_with_mesh(plain);
  b.add_node_with_mesh(plain, R"({"translation": [0, 5, 0]})");
  b.add_node_with_mesh(morphed);
  b.add_node_with_mesh(bent, R"({"skin": 0})");
  b.add_node("{}");
  b.add("skins", R"({"joints": [4]})");
  const int input = b.add_floats("SCALAR", {0, 1});
  const int moves = b.add_vec3({{0, 0, 0}, {4, 0, 0}});
  const int weights = b.add_floats("SCALAR", {0, 1});
  const auto sampler = [&](int output) {
    return R"({"input": )" + std::to_string(input) + R"(, "output": )" + std::to_string(output) +
           "}";
  };
  b.add("animations", R"({"samplers": [)" + sampler(moves) + ", " + sampler(weights) +
                          R"(], "channels": [
      {"sampler": 0, "target": {"node": 0, "path": "translation"}},
      {"sampler": 0, "target": {"node": 4, "path": "translation"}},
      {"sampler": 1, "target": {"node": 2, "path": "weights"}}]})");
  return b.gltf();
}

contract::RenderSettings ten_a_second() {
  contract::RenderSettings settings;
  settings.fps = 10;
  return settings;
}

/// Poses frames of one file, one after the other.
class Film {
 public:
  Film() {
    reader_.put("scene.gltf", moving_scene());
    auto file = load_scene_file("scene.gltf", ten_a_second(), reader_);
    EXPECT_TRUE(file.ok()) << file.status();
    file_ = *std::move(file);
  }
  Scene frame(int number) {
    auto scene = file_->pose(ten_a_second(), number);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene.ok() ? *std::move(scene) : Scene();
  }

 private:
  MemoryReader reader_;
  std::unique_ptr<SceneFile> file_;
};

void expect_equal(const Scene& a, const Scene& b) {
  ASSERT_EQ(a.meshes.size(), b.meshes.size());
  for (std::size_t i = 0; i < a.meshes.size(); ++i) {
    ASSERT_EQ(a.meshes[i].primitives.size(), b.meshes[i].primitives.size());
    for (std::size_t k = 0; k < a.meshes[i].primitives.size(); ++k) {
      const Primitive &p = a.meshes[i].primitives[k], &q = b.meshes[i].primitives[k];
      EXPECT_EQ(p.positions, q.positions);
      EXPECT_EQ(p.triangles, q.triangles);
      EXPECT_EQ(p.uv[0], q.uv[0]);
      EXPECT_EQ(p.material, q.material);
    }
  }
  ASSERT_EQ(a.instances.size(), b.instances.size());
  for (std::size_t i = 0; i < a.instances.size(); ++i) {
    EXPECT_EQ(a.instances[i].object_to_world, b.instances[i].object_to_world);
    EXPECT_EQ(a.instances[i].mesh, b.instances[i].mesh);
  }
  ASSERT_EQ(a.images.size(), b.images.size());
  for (std::size_t i = 0; i < a.images.size(); ++i) EXPECT_EQ(a.images[i].u8, b.images[i].u8);
  EXPECT_EQ(a.center, b.center);
  EXPECT_EQ(a.materials.size(), b.materials.size());
}

TEST(Frames, PoseIsIndependentOfEarlierFrames) {
  Film film;
  for (const int number : {0, 7, 10, 3, 3, 0}) {
    const Scene scene = film.frame(number);
    expect_equal(scene, Film().frame(number));
  }
}

TEST(Frames, ShareImagesAndRigidMeshes) {
  Film film;
  const Scene first = film.frame(0), second = film.frame(5), again = film.frame(5);
  ASSERT_EQ(first.meshes.size(), 3u);
  ASSERT_EQ(first.images.size(), 1u);
  EXPECT_TRUE(second.images[0].u8.shares(first.images[0].u8));
  EXPECT_TRUE(second.meshes[0].primitives.shares(first.meshes[0].primitives));
  EXPECT_FALSE(second.meshes[1].primitives.shares(first.meshes[1].primitives))
      << "the mesh is morphed";
  EXPECT_TRUE(again.meshes[1].primitives.shares(second.meshes[1].primitives));
  EXPECT_FALSE(again.meshes[2].primitives.shares(second.meshes[2].primitives))
      << "the mesh is skinned";
}

TEST(Frames, UnusedMeshesAreReleased) {
  Film film;
  const Scene first = film.frame(0);
  film.frame(5);
  EXPECT_FALSE(film.frame(0).meshes[1].primitives.shares(first.meshes[1].primitives));
}

}  // namespace
}  // namespace tessera::render
