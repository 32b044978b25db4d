#include <gtest/gtest.h>
#include <meshoptimizer.h>

#include <cmath>
#include <cstring>
#include <string>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#pragma GCC diagnostic pop

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"

namespace tessera::render {
namespace {

using testing::bytes_of;
using testing::GltfBuilder;
using testing::load_and_pose;

constexpr int kSide = 9;

/// A wavy grid of kSide x kSide vertices.
std::vector<Vec3f> grid_positions() {
  std::vector<Vec3f> out;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      out.push_back(
          {static_cast<float>(x), static_cast<float>(y), std::sin(static_cast<float>(x * y))});
    }
  }
  return out;
}

std::vector<std::uint32_t> grid_indices() {
  std::vector<std::uint32_t> out;
  for (std::uint32_t y = 0; y + 1 < kSide; ++y) {
    for (std::uint32_t x = 0; x + 1 < kSide; ++x) {
      const std::uint32_t i = y * kSide + x;
      for (const std::uint32_t k : {i, i + 1, i + kSide, i + 1, i + kSide + 1, i + kSide}) {
        out.push_back(k);
      }
    }
  }
  return out;
}

/// Adds a compressed view over `encoded` whose fallback buffer (index 1) has no data.
int add_meshopt_view(GltfBuilder& b, const std::vector<unsigned char>& encoded, std::size_t count,
                     std::size_t stride, const std::string& mode, const std::string& filter) {
  const int raw = b.add_view(bytes_of(encoded));
  const std::string index = std::to_string(raw);
  // The raw view becomes the compressed one: its own range moves into the extension.
  std::size_t offset = 0;
  const std::string text = b.gltf();
  const std::size_t views = text.find("\"bufferViews\"");
  std::size_t at = views;
  for (int i = 0; i <= raw; ++i) at = text.find("\"byteOffset\":", at + 1);
  offset = std::stoul(text.substr(at + 13));
  b.set("/bufferViews/" + index,
        R"({"buffer": 1, "byteLength": )" + std::to_string(count * stride) +
            (mode == "ATTRIBUTES" ? R"(, "byteStride": )" + std::to_string(stride) : "") +
            R"(, "extensions": {"EXT_meshopt_compression": {"buffer": 0, "byteOffset": )" +
            std::to_string(offset) + R"(, "byteLength": )" + std::to_string(encoded.size()) +
            R"(, "byteStride": )" + std::to_string(stride) + R"(, "count": )" +
            std::to_string(count) + R"(, "mode": ")" + mode + R"(", "filter": ")" + filter +
            R"("}}})");
  return raw;
}

std::vector<unsigned char> encode_vertices(const void* data, std::size_t count,
                                           std::size_t stride) {
  std::vector<unsigned char> out(meshopt_encodeVertexBufferBound(count, stride));
  out.resize(meshopt_encodeVertexBuffer(out.data(), out.size(), data, count, stride));
  return out;
}

GltfBuilder& meshopt_grid(GltfBuilder& b, bool triangles_mode) {
  b.use_extension("EXT_meshopt_compression", true);
  const auto positions = grid_positions();
  const auto indices = grid_indices();
  const auto vertices = encode_vertices(positions.data(), positions.size(), sizeof(Vec3f));
  std::vector<unsigned char> encoded(
      triangles_mode ? meshopt_encodeIndexBufferBound(indices.size(), positions.size())
                     : meshopt_encodeIndexSequenceBound(indices.size(), positions.size()));
  encoded.resize(triangles_mode ? meshopt_encodeIndexBuffer(encoded.data(), encoded.size(),
                                                            indices.data(), indices.size())
                                : meshopt_encodeIndexSequence(encoded.data(), encoded.size(),
                                                              indices.data(), indices.size()));
  const int v =
      add_meshopt_view(b, vertices, positions.size(), sizeof(Vec3f), "ATTRIBUTES", "NONE");
  const int i = add_meshopt_view(b, encoded, indices.size(), 4,
                                 triangles_mode ? "TRIANGLES" : "INDICES", "NONE");
  b.add_accessor({.view = v, .count = kSide * kSide, .type = "VEC3"});
  b.add_accessor({.view = i,
                  .component_type = testing::kUnsignedInt,
                  .count = static_cast<std::int64_t>(indices.size())});
  b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]})");
  b.add_node_with_mesh(0);
  b.set("/buffers", R"([{}, {"byteLength": 4, "extensions":
                         {"EXT_meshopt_compression": {"fallback": true}}}])");
  return b;
}

/// Triangles as corner positions, so that vertex order does not matter.
std::vector<Vec3f> corners(const Primitive& p) {
  std::vector<Vec3f> out;
  for (const auto& t : p.triangles) {
    for (const std::uint32_t v : t) out.push_back(p.positions[v]);
  }
  return out;
}

TEST(Meshopt, EncodedMeshRoundTrips) {
  const auto positions = grid_positions();
  const auto indices = grid_indices();
  for (const bool triangles : {true, false}) {
    GltfBuilder b;
    const auto scene = load_and_pose(meshopt_grid(b, triangles));
    ASSERT_TRUE(scene.ok()) << scene.status();
    const Primitive& p = scene->meshes[0].primitives[0];
    EXPECT_EQ(p.positions, positions);
    ASSERT_EQ(p.triangles.size(), indices.size() / 3);
    // The triangle codec may rotate a triangle's corners, never change its winding or order.
    for (std::size_t t = 0; t < p.triangles.size(); ++t) {
      const auto& got = p.triangles[t];
      bool rotation = false;
      for (std::size_t r = 0; r < 3; ++r) {
        rotation =
            rotation || (got[r] == indices[3 * t] && got[(r + 1) % 3] == indices[3 * t + 1] &&
                         got[(r + 2) % 3] == indices[3 * t + 2]);
      }
      EXPECT_TRUE(rotation) << t;
    }
  }
}

TEST(Meshopt, UnmarkedFallbackBufferNeedsNoBytes) {
  GltfBuilder b;
  meshopt_grid(b, true).set("/buffers", R"([{}, {"byteLength": 4}])");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  b.set("/bufferViews/0/extensions", "{}");
  const std::string message(load_and_pose(b).status().message());
  EXPECT_NE(message.find("buffers[1]: no uri"), std::string::npos) << message;
}

TEST(Meshopt, FiltersAreDecoded) {
  GltfBuilder b;
  b.use_extension("EXT_meshopt_compression", true);
  const std::vector<float> normals = {0, 0, 1, 0, 0.6f, 0, 0.8f, 0, -0.48f, 0.6f, -0.64f, 0};
  std::vector<std::int8_t> packed(12);
  meshopt_encodeFilterOct(packed.data(), 3, 4, 8, normals.data());
  const std::vector<float> positions = {0, 0, 0, 1.5f, 0, 0, 0, -2.25f, 0};
  std::vector<std::uint32_t> exponents(9);
  meshopt_encodeFilterExp(exponents.data(), 3, 12, 15, positions.data());
  const int n =
      add_meshopt_view(b, encode_vertices(packed.data(), 3, 4), 3, 4, "ATTRIBUTES", "OCTAHEDRAL");
  const int p = add_meshopt_view(b, encode_vertices(exponents.data(), 3, 12), 3, 12, "ATTRIBUTES",
                                 "EXPONENTIAL");
  b.add_accessor({.view = p, .count = 3, .type = "VEC3"});
  b.add_accessor({.view = n,
                  .component_type = testing::kByte,
                  .count = 3,
                  .type = "VEC3",
                  .normalized = true});
  b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}}]})");
  b.add_node_with_mesh(0);
  b.set("/buffers", R"([{}, {"byteLength": 4, "extensions":
                         {"EXT_meshopt_compression": {"fallback": true}}}])");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& got = scene->meshes[0].primitives[0];
  EXPECT_EQ(got.positions[1], (Vec3f{1.5f, 0, 0}));
  EXPECT_EQ(got.positions[2], (Vec3f{0, -2.25f, 0}));
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3f want = {normals[4 * i], normals[4 * i + 1], normals[4 * i + 2]};
    EXPECT_GT(dot(got.normals[i], want), 0.999f) << i;  // 8 bits: within half a degree or so
  }
}

TEST(Meshopt, DamagedStreamsAreRejected) {
  const auto refused = [](const std::string& member, const std::string& value) {
    GltfBuilder b;
    meshopt_grid(b, true);
    b.set("/bufferViews/0/extensions/EXT_meshopt_compression/" + member, value);
    const auto scene = load_and_pose(b);
    EXPECT_EQ(scene.status().code(), absl::StatusCode::kInvalidArgument) << member << " " << value;
    EXPECT_NE(std::string(scene.status().message()).find("bufferViews[0]"), std::string::npos)
        << scene.status();
  };
  refused("count", "4294967295");
  refused("count", "1099511627775");
  refused("count", "0");
  refused("byteStride", "13");
  refused("byteStride", "1024");
  refused("byteLength", "7");
  refused("byteLength", "4294967295");
  refused("byteOffset", "4294967295");
  refused("buffer", "9");
  refused("mode", "\"TRIANGLES\"");
  refused("mode", "\"POINTS\"");
  refused("filter", "\"QUATERNION\"");
  refused("filter", "\"SHARPEN\"");
}

struct DracoGrid {
  std::vector<std::byte> stream;
  std::size_t points = 0, faces = 0;
};

/// The grid encoded by Draco at `bits` of position quantisation.
DracoGrid encode_draco(int bits) {
  const auto positions = grid_positions();
  const auto indices = grid_indices();
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(static_cast<int>(indices.size() / 3));
  const int attribute =
      builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  for (std::size_t f = 0; f < indices.size() / 3; ++f) {
    builder.SetAttributeValuesForFace(attribute, draco::FaceIndex(static_cast<std::uint32_t>(f)),
                                      &positions[indices[3 * f]], &positions[indices[3 * f + 1]],
                                      &positions[indices[3 * f + 2]]);
  }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::Encoder encoder;
  encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, bits);
  encoder.SetSpeedOptions(5, 5);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeMeshToBuffer(*mesh, &buffer).ok());
  DracoGrid out;
  out.stream.resize(buffer.size());
  std::memcpy(out.stream.data(), buffer.data(), buffer.size());
  out.points = encoder.num_encoded_points();
  out.faces = encoder.num_encoded_faces();
  if (out.points == 0) out.points = mesh->num_points();
  if (out.faces == 0) out.faces = mesh->num_faces();
  return out;
}

GltfBuilder& draco_grid(GltfBuilder& b, const DracoGrid& grid) {
  b.use_extension("KHR_draco_mesh_compression", true);
  const int view = b.add_view(grid.stream);
  b.add_accessor({.count = static_cast<std::int64_t>(grid.points), .type = "VEC3"});
  b.add_accessor({.component_type = testing::kUnsignedShort,
                  .count = static_cast<std::int64_t>(grid.faces * 3)});
  b.add("meshes", R"({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "extensions":
      {"KHR_draco_mesh_compression": {"bufferView": )" +
                      std::to_string(view) + R"(, "attributes": {"POSITION": 0}}}}]})");
  b.add_node_with_mesh(0);
  return b;
}

TEST(Draco, EncodedSurfaceRoundTrips) {
  GltfBuilder b;
  const DracoGrid grid = encode_draco(16);
  const auto scene = load_and_pose(draco_grid(b, grid));
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& p = scene->meshes[0].primitives[0];
  ASSERT_EQ(p.triangles.size(), grid_indices().size() / 3);
  // Draco reorders triangles: each corner must lie on a vertex of the grid within the quantum.
  const auto positions = grid_positions();
  const float quantum = 8.0f / 65535.0f;
  double area = 0;
  const auto got = corners(p);
  for (std::size_t c = 0; c < got.size(); ++c) {
    float nearest = 1e9f;
    for (const Vec3f& q : positions) nearest = std::min(nearest, max_abs(got[c] - q));
    EXPECT_LE(nearest, quantum);
    if (c % 3 == 2) area += cross(got[c - 1] - got[c - 2], got[c] - got[c - 2]).z / 2;
  }
  EXPECT_NEAR(area, 64, 0.1) << "all triangles, all facing +z";
}

TEST(Draco, DamagedStreamsAreRejected) {
  const DracoGrid good = encode_draco(10);
  const auto message = [](const DracoGrid& grid, const std::string& pointer = {},
                          const std::string& value = {}) {
    GltfBuilder b;
    draco_grid(b, grid);
    if (!pointer.empty()) b.set(pointer, value);
    const auto scene = load_and_pose(b);
    EXPECT_EQ(scene.status().code(), absl::StatusCode::kInvalidArgument) << pointer;
    return std::string(scene.status().message());
  };
  DracoGrid cut = good;
  cut.stream.resize(cut.stream.size() / 2);
  EXPECT_NE(message(cut).find("Draco stream is damaged"), std::string::npos);
  DracoGrid noise = good;
  for (std::size_t i = 0; i < noise.stream.size(); ++i) noise.stream[i] = std::byte{0xA5};
  message(noise);
  EXPECT_NE(message(good, "/accessors/0/count", "12").find("count"), std::string::npos);
  message(good, "/accessors/0/type", "\"VEC2\"");
  const std::string extension = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression/";
  message(good, extension + "attributes/POSITION", "77");
  message(good, extension + "bufferView", "77");
}

TEST(Draco, AnyCorruptByteIsHandled) {
  const DracoGrid good = encode_draco(8);
  for (std::size_t i = 0; i < good.stream.size(); ++i) {
    DracoGrid changed = good;
    changed.stream[i] ^= std::byte{0x81};
    GltfBuilder b;
    const auto scene = load_and_pose(draco_grid(b, changed));
    EXPECT_TRUE(scene.ok() || scene.status().code() == absl::StatusCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace tessera::render
