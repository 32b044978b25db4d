#include "worker/gltf/file/memory_budget.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"
#include "tests/support/scratch_folder.h"

namespace tessera::render {
namespace {

namespace fs = std::filesystem;
using testing::GltfBuilder;
using testing::MemoryReader;

void write(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << text;
}

TEST(MachineMemory, IsPositiveAndAtMostPhysical) {
  const std::uint64_t bytes = machine_memory_bytes();
  EXPECT_GT(bytes, std::uint64_t{64} << 20);
  EXPECT_LT(bytes, std::uint64_t{1} << 48);
}

TEST(MachineMemory, GroupVersionTwoLimitsIt) {
  const ScratchFolder root;
  const fs::path top = root.path(), groups = top / "sys/fs/cgroup";
  write(top / "proc/self/cgroup", "0::/outer/inner\n");
  write(groups / "memory.max", "max\n");
  write(groups / "outer/memory.max", "41943040\n");
  write(groups / "outer/inner/memory.max", "max\n");
  EXPECT_EQ(machine_memory_bytes(top), 41'943'040u);
  write(groups / "outer/inner/memory.max", "1048576\n");
  EXPECT_EQ(machine_memory_bytes(top), 1'048'576u);
}

TEST(MachineMemory, GroupVersionOneLimitsIt) {
  const ScratchFolder root;
  const fs::path top = root.path();
  write(top / "proc/self/cgroup", "5:cpu:/a\n4:memory:/host/path\n");
  write(top / "sys/fs/cgroup/memory/memory.limit_in_bytes", "2097152\n");
  EXPECT_EQ(machine_memory_bytes(top), 2'097'152u);
}

TEST(MachineMemory, ControlGroupsMayBeMissing) {
  const ScratchFolder root;
  EXPECT_GT(machine_memory_bytes(root.path()), std::uint64_t{64} << 20);
}

/// A mesh of `triangles` triangles, 9 floats each.
GltfBuilder& add_mesh(GltfBuilder& b, std::size_t triangles) {
  std::vector<Vec3f> corners;
  for (std::size_t i = 0; i < triangles; ++i) {
    const auto x = static_cast<float>(i);
    corners.insert(corners.end(), {Vec3f{x, 0, 0}, Vec3f{x + 1, 0, 0}, Vec3f{x, 1, 0}});
  }
  b.add_node_with_mesh(b.add_mesh({.positions = corners, .indices = {}, .normals = {}, .uv = {}}));
  return b;
}

absl::Status load_with(const GltfBuilder& b, std::uint64_t memory) {
  MemoryReader reader;
  reader.put("scene.gltf", b.gltf());
  reader.limit_memory(memory);
  const auto file = load_scene_file("scene.gltf", {}, reader);
  return file.ok() ? (*file)->pose({}, 0).status() : file.status();
}

TEST(MemoryLimit, MeshesBeyondItAreRefused) {
  GltfBuilder b;
  add_mesh(b, 1000);
  EXPECT_TRUE(load_with(b, 1'000'000).ok());
  const absl::Status refused = load_with(b, 30'000);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(refused.message(),
            "scene.gltf: meshes[0]: takes 36000 bytes decoded, more than the 30000 left of 30000 "
            "bytes of memory; simplify the scene, or give it a machine with more memory or a "
            "higher memory limit");
}

TEST(MemoryLimit, MeshesAreAddedUp) {
  GltfBuilder b;
  add_mesh(add_mesh(b, 1000), 1000);
  const absl::Status refused = load_with(b, 60'000);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_NE(refused.message().find("meshes[1]"), std::string::npos) << refused;
  EXPECT_TRUE(load_with(b, 200'000).ok());
}

TEST(MemoryLimit, SharedMeshesCountOnce) {
  GltfBuilder b;
  add_mesh(b, 1000);
  for (int i = 0; i < 20; ++i) b.add_node_with_mesh(0);
  EXPECT_TRUE(load_with(b, 100'000).ok());
}

}  // namespace
}  // namespace tessera::render
