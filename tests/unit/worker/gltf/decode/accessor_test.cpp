#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/gltf/decode/geometry_reader.h"

namespace tessera::render {
namespace {

using testing::AccessorSpec;
using testing::bytes_of;
using testing::GltfBuilder;
using testing::load_and_pose;

constexpr const char* kTextured = R"({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})";

/// A posed triangle whose TEXCOORD_0 is the accessor that `uv_accessor` adds.
template <typename AddUv>
Primitive primitive_with_uv(AddUv add_uv) {
  GltfBuilder b;
  // 1 x 1 white PNG.
  b.add(
      "images",
      R"({"uri": "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8/5+hHgAHggJ/PchI7wAAAABJRU5ErkJggg=="})");
  b.add_texture(0);
  const int material = b.add_material(kTextured);
  const int mesh = b.add_mesh({.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}},
                               .indices = {},
                               .normals = {},
                               .uv = {},
                               .material = material});
  b.set("/meshes/0/primitives/0/attributes/TEXCOORD_0", std::to_string(add_uv(b)));
  b.add_node_with_mesh(mesh);
  const auto scene = load_and_pose(b);
  EXPECT_TRUE(scene.ok()) << scene.status();
  return scene.ok() ? scene->meshes.at(0).primitives[0] : Primitive();
}

/// Three VEC2 elements of integers; returns x of the second element.
template <typename T>
float decoded(T value, int component_type, bool normalized) {
  const Primitive p = primitive_with_uv([&](GltfBuilder& b) {
    const std::vector<T> values = {0, 0, value, 0, 0, 0};
    return b.add_accessor({.view = b.add_view(bytes_of(values)),
                           .component_type = component_type,
                           .count = 3,
                           .type = "VEC2",
                           .normalized = normalized});
  });
  return p.uv[0].empty() ? -99.0f : p.uv[0][1].x;
}

TEST(Accessors, EveryComponentTypeIsDecoded) {
  EXPECT_EQ(decoded<std::int8_t>(-128, testing::kByte, false), -128.0f);
  EXPECT_EQ(decoded<std::int8_t>(-128, testing::kByte, true), -1.0f);
  EXPECT_EQ(decoded<std::int8_t>(127, testing::kByte, true), 1.0f);
  EXPECT_EQ(decoded<std::uint8_t>(255, testing::kUnsignedByte, false), 255.0f);
  EXPECT_EQ(decoded<std::uint8_t>(51, testing::kUnsignedByte, true), 0.2f);
  EXPECT_EQ(decoded<std::int16_t>(-32768, testing::kShort, false), -32768.0f);
  EXPECT_EQ(decoded<std::int16_t>(-32768, testing::kShort, true), -1.0f);
  EXPECT_EQ(decoded<std::int16_t>(32767, testing::kShort, true), 1.0f);
  EXPECT_EQ(decoded<std::uint16_t>(65535, testing::kUnsignedShort, false), 65535.0f);
  EXPECT_EQ(decoded<std::uint16_t>(13107, testing::kUnsignedShort, true), 0.2f);
  EXPECT_EQ(decoded<std::uint32_t>(4294967295u, testing::kUnsignedInt, true), 1.0f);
  EXPECT_EQ(decoded<std::uint32_t>(16777216u, testing::kUnsignedInt, false), 16777216.0f);
  EXPECT_EQ(decoded<float>(-0.375f, testing::kFloat, false), -0.375f);
}

TEST(Accessors, InterleavedViewsUseStride) {
  // x, y, z, u, v per vertex, in one view of stride 20.
  const std::vector<float> data = {0, 0, 0, 0.25f, 0.5f, 1, 0, 0, 0.75f, 0.125f, 0, 1, 0, 1, 0};
  GltfBuilder b;
  const int view = b.add_view(bytes_of(data), 20);
  b.add_accessor({.view = view, .count = 3, .type = "VEC3"});
  b.add_accessor({.view = view, .count = 3, .type = "VEC2", .byte_offset = 12});
  b.add(
      "images",
      R"({"uri": "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8/5+hHgAHggJ/PchI7wAAAABJRU5ErkJggg=="})");
  b.add_texture(0);
  b.add_material(kTextured);
  b.add("meshes",
        R"({"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]})");
  b.add_node_with_mesh(0);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& p = scene->meshes[0].primitives[0];
  EXPECT_EQ(p.positions[1], (Vec3f{1, 0, 0}));
  EXPECT_EQ(p.uv[0][1], (Vec2f{0.75f, 0.125f}));
  EXPECT_EQ(p.uv[0][2], (Vec2f{1, 0}));
}

TEST(Accessors, SparseElementsReplaceValues) {
  for (const bool over_zeros : {false, true}) {
    GltfBuilder b;
    const std::vector<Vec3f> base = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {5, 5, 5}};
    const std::vector<std::uint16_t> places = {1, 3};
    const std::vector<Vec3f> values = {{2, 0, 0}, {0, 0, 7}};
    const int view = b.add_view(bytes_of(base));
    const int index_view = b.add_view(bytes_of(places));
    const int value_view = b.add_view(bytes_of(values));
    b.add_accessor({.view = over_zeros ? -1 : view, .count = 4, .type = "VEC3"});
    b.set("/accessors/0/sparse",
          R"({"count": 2, "indices": {"componentType": 5123, "bufferView": )" +
              std::to_string(index_view) + R"(}, "values": {"bufferView": )" +
              std::to_string(value_view) + "}}");
    b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]})");
    b.add_node_with_mesh(0);
    const auto scene = load_and_pose(b);
    ASSERT_TRUE(scene.ok()) << scene.status();
    const auto& p = scene->meshes[0].primitives[0].positions;
    EXPECT_EQ(p[0], (Vec3f{0, 0, 0}));
    EXPECT_EQ(p[1], (Vec3f{2, 0, 0}));
    EXPECT_EQ(p[2], over_zeros ? (Vec3f{0, 0, 0}) : (Vec3f{0, 1, 0}));
    EXPECT_EQ(p[3], (Vec3f{0, 0, 7}));
  }
}

/// 1 MiB and 16 times the bytes of the buffers.
TEST(Accessors, SizeOfZerosFollowsThatOfBuffers) {
  const auto load = [](std::int64_t count) {
    GltfBuilder b;
    b.add_view(std::vector<std::byte>(1024));
    b.add_accessor({.view = -1, .count = count, .type = "VEC3"});
    b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0}}]})");
    b.add_node_with_mesh(0);
    return load_and_pose(b).status();
  };
  constexpr std::int64_t kMaxCount = ((1 << 20) + 16 * 1024) / 12;
  EXPECT_TRUE(load(kMaxCount).ok()) << load(kMaxCount);
  const absl::Status refused = load(kMaxCount + 1);
  EXPECT_NE(refused.message().find("accessors[0]: count 88747 without a bufferView decodes to more "
                                   "than 1064960 bytes"),
            std::string::npos)
      << refused;
}

TEST(Accessors, EveryIndexTypeIsRead) {
  const auto positions_of = [](auto sample, int type) {
    using T = decltype(sample);
    GltfBuilder b;
    b.add_vec3({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}});
    const std::vector<T> indices = {3, 1, 2};
    b.add_accessor({.view = b.add_view(bytes_of(indices)), .component_type = type, .count = 3});
    b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]})");
    b.add_node_with_mesh(0);
    const auto scene = load_and_pose(b);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene->meshes[0].primitives[0].triangles;
  };
  const std::vector<std::array<std::uint32_t, 3>> want = {{3, 1, 2}};
  EXPECT_EQ(positions_of(std::uint8_t{}, testing::kUnsignedByte), want);
  EXPECT_EQ(positions_of(std::uint16_t{}, testing::kUnsignedShort), want);
  EXPECT_EQ(positions_of(std::uint32_t{}, testing::kUnsignedInt), want);
}

TEST(Triangles, StripsAndFansKeepWinding) {
  using Triangles = std::vector<std::array<std::uint32_t, 3>>;
  const std::vector<std::uint32_t> corners = {10, 11, 12, 13, 14};
  EXPECT_EQ(assemble_triangles(PrimitiveMode::triangles, corners), (Triangles{{10, 11, 12}}));
  EXPECT_EQ(assemble_triangles(PrimitiveMode::strip, corners),
            (Triangles{{10, 11, 12}, {11, 13, 12}, {12, 13, 14}}));
  EXPECT_EQ(assemble_triangles(PrimitiveMode::fan, corners),
            (Triangles{{11, 12, 10}, {12, 13, 10}, {13, 14, 10}}));
  EXPECT_TRUE(assemble_triangles(PrimitiveMode::strip, {1, 2}).empty());
}

TEST(Triangles, PlanarStripFacesOneWay) {
  // A zigzag in the plane z = 0, counter-clockwise seen from +z.
  const std::vector<Vec3f> p = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0, 2, 0}, {1, 2, 0}};
  const auto triangles = assemble_triangles(PrimitiveMode::strip, {0, 1, 2, 3, 4, 5});
  for (const auto& t : triangles) {
    EXPECT_GT(cross(p[t[1]] - p[t[0]], p[t[2]] - p[t[0]]).z, 0);
  }
}

TEST(Quantization, NodeTransformScalesIntegers) {
  // KHR_mesh_quantization: unsigned shorts, normalised, scaled back by the node.
  GltfBuilder b;
  b.use_extension("KHR_mesh_quantization", true);
  const std::vector<std::uint16_t> data = {0, 0, 0, 0, 65535, 0, 0, 0, 0, 65535, 13107, 0};
  b.add_accessor({.view = b.add_view(bytes_of(data), 8),
                  .component_type = testing::kUnsignedShort,
                  .count = 3,
                  .type = "VEC3",
                  .normalized = true});
  const std::vector<std::int8_t> normals = {0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0};
  b.add_accessor({.view = b.add_view(bytes_of(normals), 4),
                  .component_type = testing::kByte,
                  .count = 3,
                  .type = "VEC3",
                  .normalized = true});
  b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}}]})");
  b.add_node_with_mesh(0, R"({"scale": [10, 10, 10], "translation": [1, 2, 3]})");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& p = scene->meshes[0].primitives[0];
  EXPECT_EQ(p.positions[2], (Vec3f{0, 1, 0.2f}));
  EXPECT_EQ(p.normals[0], (Vec3f{0, 0, 1}));
  const Vec3d world =
      transform_point(scene->instances[0].object_to_world, Vec3d(p.positions[2])) + scene->center;
  EXPECT_NEAR(world.x, 1, 1e-12);
  EXPECT_NEAR(world.y, 12, 1e-12);
  EXPECT_NEAR(world.z, 3 + 10 * static_cast<double>(0.2f), 1e-12);
}

TEST(VertexColors, ThreeComponentsAreOpaque) {
  GltfBuilder b;
  b.add_vec3({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  const std::vector<std::uint8_t> colors = {255, 0, 0, 51, 0, 255, 0, 255, 0, 0, 255, 0};
  b.add_accessor({.view = b.add_view(bytes_of(colors)),
                  .component_type = testing::kUnsignedByte,
                  .count = 3,
                  .type = "VEC4",
                  .normalized = true});
  b.add_floats("VEC3", {1, 0, 0, 0, 1, 0, 0, 0, 1});
  b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}},
                                     {"attributes": {"POSITION": 0, "COLOR_0": 2}}]})");
  b.add_node_with_mesh(0);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes[0].primitives[0].colors[0], (Vec4f{1, 0, 0, 0.2f}));
  EXPECT_EQ(scene->meshes[0].primitives[1].colors[2], (Vec4f{0, 0, 1, 1}));
}

TEST(VertexColors, OutOfRangeIsClampedWithWarning) {  // glTF 2.0, section 3.7.2.1
  testing::MemoryReader reader;
  GltfBuilder b;
  b.add_vec3({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  b.add_floats("VEC4", {5, -1, 0.5f, 2, 0, 0, 0, 1, 1, 1, 1, 1});
  b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}}]})");
  b.add_node_with_mesh(0);
  reader.put("scene.gltf", b.gltf());
  const auto file = load_scene_file("scene.gltf", {}, reader);
  const auto scene = (*file)->pose({}, 0);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes[0].primitives[0].colors[0], (Vec4f{1, 0, 0.5f, 1}));
  ASSERT_FALSE((*file)->problems().empty());
  EXPECT_EQ((*file)->problems()[0].message, "COLOR_0 is outside [0, 1]; clamped");
}

TEST(Positions, InvalidOnesDropTrianglesWithWarning) {
  testing::MemoryReader reader;
  GltfBuilder b;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  b.add_mesh({.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {nan, 0, 0}, {1e19f, 0, 0}},
              .indices = {0, 1, 2, 0, 1, 3, 1, 2, 4},
              .normals = {},
              .uv = {},
              .material = -1});
  b.add_node_with_mesh(0);
  reader.put("scene.gltf", b.gltf());
  const auto file = load_scene_file("scene.gltf", {}, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  const auto scene = (*file)->pose({}, 0);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes[0].primitives[0].triangles.size(), 1u);
  EXPECT_EQ(scene->bounds_max, (Vec3d{0.5, 0.5, 0}));
  bool has_warning = false;
  for (const Problem& p : (*file)->problems()) {
    has_warning = has_warning ||
                  (p.element == "meshes[0].primitives[0]" && p.message.starts_with("2 triangles"));
  }
  EXPECT_TRUE(has_warning);
}

TEST(Primitives, PointsAndLinesAreSkippedWithWarning) {
  testing::MemoryReader reader;
  GltfBuilder b;
  b.add_vec3({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0}, "mode": 0},
                                     {"attributes": {"POSITION": 0}, "mode": 3},
                                     {"attributes": {"POSITION": 0}}]})");
  b.add_node_with_mesh(0);
  reader.put("scene.gltf", b.gltf());
  const auto file = load_scene_file("scene.gltf", {}, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  const auto scene = (*file)->pose({}, 0);
  ASSERT_TRUE(scene.ok());
  ASSERT_EQ(scene->meshes[0].primitives.size(), 1u);
  EXPECT_EQ(scene->meshes[0].primitives[0].id, 2);
  EXPECT_EQ((*file)->problems().size(), 3u);  // points, lines, no light
}

}  // namespace
}  // namespace tessera::render
