#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"
#include "tests/support/scratch_folder.h"
#include "worker/gltf/file/folder_reader.h"

namespace tessera::render {
namespace {

namespace fs = std::filesystem;

/// tests/scenes/malformed/cases.txt: FILE <tab> text its message must contain.
struct Case {
  std::string file, text;
};

std::vector<Case> cases(const fs::path& folder) {
  std::vector<Case> out;
  std::ifstream list(folder / "cases.txt");
  for (std::string line; std::getline(list, line);) {
    const std::size_t tab = line.find('\t');
    out.push_back({line.substr(0, tab), line.substr(tab + 1)});
  }
  return out;
}

absl::Status load(FolderReader& reader, const std::string& file) {
  const auto loaded = load_scene_file(file, {}, reader);
  if (!loaded.ok()) return loaded.status();
  return (*loaded)->pose({}, 0).status();
}

TEST(Malformed, ErrorsNameFileElementAndFault) {
  const fs::path folder = fs::path(TESSERA_SOURCE_DIR) / "tests/scenes/malformed";
  const std::vector<Case> all = cases(folder);
  ASSERT_GT(all.size(), 100u);
  for (const Case& c : all) {
    FolderReader reader(folder);
    const absl::Status status = load(reader, c.file);
    const std::string message(status.message());
    EXPECT_TRUE(status.code() == absl::StatusCode::kInvalidArgument ||
                status.code() == absl::StatusCode::kUnimplemented ||
                status.code() == absl::StatusCode::kNotFound)
        << c.file << ": " << status;
    EXPECT_TRUE(message.starts_with(c.file + ": ")) << message;
    EXPECT_NE(message.find(c.text), std::string::npos) << c.file << ": " << message;
  }
}

TEST(Malformed, EveryFileIsListed) {
  const fs::path folder = fs::path(TESSERA_SOURCE_DIR) / "tests/scenes/malformed";
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    files += entry.path().filename() != "cases.txt" ? 1 : 0;
  }
  EXPECT_EQ(files, cases(folder).size());
}

/// A scene with most features, to be corrupted.
std::string rich_scene() {
  testing::GltfBuilder b;
  b.use_extension("KHR_lights_punctual");
  b.use_extension("KHR_materials_transmission");
  b.add_mesh(testing::unit_quad(b.add_material(
      R"({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}})")));
  b.set("/extensions/KHR_lights_punctual/lights", R"([{"type": "point"}])");
  b.add("cameras", R"({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}})");
  b.add_node_with_mesh(0, R"({"extensions": {"KHR_lights_punctual": {"light": 0}}})");
  b.add_node(R"({"camera": 0, "translation": [0, 0, 5]})");
  const int input = b.add_floats("SCALAR", {0, 1});
  const int output = b.add_floats("VEC3", {0, 0, 0, 1, 0, 0});
  b.add("animations", R"({"samplers": [{"input": )" + std::to_string(input) + R"(, "output": )" +
                          std::to_string(output) +
                          R"(}], "channels": [{"sampler": 0, "target":
                          {"node": 0, "path": "translation"}}]})");
  return b.glb();
}

TEST(Malformed, TruncatedAndCorruptFilesAreHandled) {
  const std::string good = rich_scene();
  ASSERT_TRUE(testing::load_and_pose(good).ok()) << testing::load_and_pose(good).status();
  for (std::size_t i = 0; i < good.size(); i += 3) {
    const auto cut = testing::load_and_pose(good.substr(0, i));
    EXPECT_FALSE(cut.ok()) << "cut at " << i;
    std::string spoiled = good;
    spoiled[i] = static_cast<char>(spoiled[i] ^ (i % 7 == 0 ? 0x80 : 0x11));
    const auto scene = testing::load_and_pose(spoiled);
    EXPECT_NE(scene.status().code(), absl::StatusCode::kInternal);
  }
}

TEST(Folder, RejectsPathsLeadingOutside) {
  const ScratchFolder scratch;
  const fs::path base = scratch.path();
  fs::create_directories(base / "scene/sub");
  std::ofstream(base / "secret.bin") << "secret";
  std::ofstream(base / "scene/sub/inside.bin") << "inside";
  fs::create_symlink(base / "secret.bin", base / "scene/leak.bin");
  fs::create_symlink(base, base / "scene/up");
  fs::create_symlink(base / "scene/sub/inside.bin", base / "scene/fine.bin");
  FolderReader reader(base / "scene");
  const auto code = [&](const char* uri) { return reader.read(uri).status().code(); };
  EXPECT_EQ(code("leak.bin"), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(code("up/secret.bin"), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(code("../secret.bin"), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(code("sub/../../secret.bin"), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(code((base / "secret.bin").c_str()), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(code("sub"), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(code("absent.bin"), absl::StatusCode::kNotFound);
  EXPECT_EQ(code("sub/inside.bin"), absl::StatusCode::kOk);
  EXPECT_EQ(code("fine.bin"), absl::StatusCode::kOk);
  reader.allow("sky.hdr", base / "secret.bin");
  const auto sky = reader.read("sky.hdr");
  ASSERT_TRUE(sky.ok());
  EXPECT_EQ(sky->size(), 6u);
}

}  // namespace
}  // namespace tessera::render
