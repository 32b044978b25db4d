#include "worker/gltf/file/container.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/support/scene/gltf_builder.h"
#include "worker/gltf/file/uri.h"

namespace tessera::render {
namespace {

using testing::GltfBuilder;

std::span<const std::byte> bytes(const std::string& text) {
  return std::as_bytes(std::span<const char>(text));
}

std::string text_of(const std::vector<std::byte>& data) {
  return {reinterpret_cast<const char*>(data.data()), data.size()};
}

TEST(Container, GlbSplitsIntoJsonAndBinary) {
  GltfBuilder b;
  b.add_floats("SCALAR", {1, 2});
  const std::string file = b.glb();
  const auto parts = split_container(bytes(file));
  ASSERT_TRUE(parts.ok()) << parts.status();
  EXPECT_EQ(parts->json.substr(0, 1), "{");
  ASSERT_TRUE(parts->has_bin);
  EXPECT_EQ(parts->bin.size(), 8u);
}

TEST(Container, TruncatedGlbIsRejected) {
  GltfBuilder b;
  b.add_floats("SCALAR", {1, 2});
  const std::string file = b.glb();
  for (std::size_t size = 4; size < file.size(); ++size) {
    const std::string cut = file.substr(0, size);
    EXPECT_FALSE(split_container(bytes(cut)).ok()) << size;
  }
}

TEST(Container, NestingIgnoresStrings) {
  EXPECT_EQ(json_depth(R"({"a": "[[[[", "b": ["\"{", [0]]})"), 3);
  EXPECT_EQ(json_depth("{}"), 1);
}

TEST(Container, NestingIsLimitedTo64Levels) {
  const auto nested = [](int depth) {
    std::string s = R"({"a":)";
    s += std::string(static_cast<std::size_t>(depth) - 1, '[');
    s += std::string(static_cast<std::size_t>(depth) - 1, ']');
    return s + "}";
  };
  EXPECT_TRUE(split_container(bytes(nested(64))).ok());
  const std::string deep = nested(65);
  const auto refused = split_container(bytes(deep));
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(Uri, Base64OfEveryLengthIsDecoded) {
  std::string plain;
  for (int n = 0; n < 40; ++n) {
    const auto data = decode_data_uri("data:x/y;base64," + testing::base64(bytes(plain)));
    ASSERT_TRUE(data.ok()) << n;
    EXPECT_EQ(text_of(*data), plain);
    plain.push_back(static_cast<char>(n * 37 + 200));
  }
}

TEST(Uri, PercentEscapesAreDecoded) {
  const auto data = decode_data_uri("data:,a%20b");
  ASSERT_TRUE(data.ok());
  EXPECT_EQ(text_of(*data), "a b");
  const auto path = relative_path("my%20folder/%C3%A9.png");
  ASSERT_TRUE(path.ok());
  EXPECT_EQ(*path, "my folder/\xC3\xA9.png");
}

TEST(Uri, PathsLeadingOutsideAreRejected) {
  for (const char* uri :
       {"../a.bin", "a/../../b", "..", "%2e%2e/a", "a/%2E%2E/b", "/etc/passwd", "%2Fetc/passwd",
        "file:///etc/passwd", "http://host/a", "C:\\a", "a\\..\\b", "a%00b", "", "%zz", "a%2",
        "%FF.png", "%C0%AE%C0%AE/a", "%ED%A0%80"}) {
    const auto path = relative_path(uri);
    EXPECT_EQ(path.status().code(), absl::StatusCode::kInvalidArgument) << uri;
  }
  EXPECT_TRUE(relative_path("..a/b..c/...").ok());
}

TEST(Uri, DamagedDataUrisAreRejected) {
  for (const char* uri : {"data:;base64", "data:;base64,a", "data:;base64,ab$=", "data:,%g0"}) {
    EXPECT_FALSE(decode_data_uri(uri).ok()) << uri;
  }
}

}  // namespace
}  // namespace tessera::render
