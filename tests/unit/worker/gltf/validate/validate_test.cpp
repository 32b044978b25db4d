#include "worker/gltf/validate/validate.h"

#include <gtest/gtest.h>

#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>

#include "worker/gltf/file/folder_reader.h"

namespace tessera::render {
namespace {

namespace fs = std::filesystem;

/// Findings of a file as "CODE<tab>POINTER".
using Verdict = std::set<std::string>;

Verdict verdict_of(const ValidationResult& result) {
  Verdict out;
  for (const ValidationFinding& each : result.findings.kept()) {
    out.insert(std::string(each.rule->code) + "\t" + each.pointer);
  }
  return out;
}

ValidationResult validate_text(const std::string& text, std::size_t limit = 1000) {
  FolderReader reader(fs::temp_directory_path());
  return validate_gltf(std::as_bytes(std::span<const char>(text)), reader, limit);
}

/// The table of the Khronos glTF validator's verdicts, by file.
std::map<std::string, Verdict> read_table() {
  std::map<std::string, Verdict> out;
  std::ifstream table(TESSERA_SOURCE_DIR "/tests/e2e/validator/verdicts.txt");
  for (std::string line; std::getline(table, line);) {
    const std::size_t tab = line.find('\t');
    Verdict& verdict = out[line.substr(0, tab)];
    const std::string finding = line.substr(tab + 1);
    if (finding != "-\t") verdict.insert(finding);
  }
  return out;
}

TEST(Validate, RepeatedKeysAreErrors) {
  const auto result = validate_text(
      R"({"asset": {"version": "1.0", "version": "2.0"},
          "nodes": [{"name": "a"}, {"extras": {"a/b": 1, "c": 2, "a/b": 3, "a/b": 4}}],
          "scene": 0, "scenes": [{"nodes": [0, 1]}], "scene": 0})");
  Verdict repeated;
  for (const std::string& each : verdict_of(result)) {
    if (each.find("DUPLICATE_KEY") == 0) repeated.insert(each.substr(each.find('\t') + 1));
  }
  EXPECT_EQ(repeated, (Verdict{"/asset/version", "/nodes/1/extras/a~1b", "/scene"}));
  EXPECT_EQ(result.findings.count(FindingSeverity::error), 3u);
}

TEST(Validate, VerdictsAreThoseOfTheTable) {
  const auto table = read_table();
  ASSERT_GT(table.size(), 200u);
  std::set<std::string> codes;
  for (const auto& [name, expected] : table) {
    FolderReader reader{fs::path(TESSERA_INVALID_DIR)};
    const auto bytes = reader.read(name);
    ASSERT_TRUE(bytes.ok()) << bytes.status();
    EXPECT_EQ(verdict_of(validate_gltf(*bytes, reader, 1000)), expected) << name;
    for (const std::string& each : expected) codes.insert(each.substr(0, each.find('\t')));
  }
  EXPECT_EQ(codes.size(), 169u) << "the table has a case for every code";
}

TEST(Validate, FindingsBeyondTheLimitAreCounted) {
  std::string nodes;
  for (int i = 0; i < 150; ++i) nodes += std::string(i > 0 ? "," : "") + "{\"scale\":[1]}";
  const std::string text = R"({"asset":{"version":"2.0"},"nodes":[)" + nodes + "]}";
  const ValidationResult result = validate_text(text, 100);
  EXPECT_EQ(result.findings.kept().size(), 100u);
  EXPECT_EQ(result.findings.count(FindingSeverity::error), 150u);
  EXPECT_EQ(result.findings.count(FindingSeverity::information), 300u);
  EXPECT_EQ(result.findings.omitted(), 350u);
}

/// A chain of nodes in which many skins name the first and the last node as joints.
std::string long_chain(int size) {
  std::ostringstream text;
  text << R"({"asset":{"version":"2.0"},"nodes":[)";
  for (int i = 0; i + 1 < size; ++i) text << "{\"children\":[" << i + 1 << "]},";
  text << R"({}],"skins":[)";
  for (int i = 0; i < size; ++i) {
    text << (i > 0 ? "," : "") << "{\"skeleton\":0,\"joints\":[0," << size - 1 << "]}";
  }
  text << "]}";
  return text.str();
}

/// CPU time of checking a chain of nodes with as many skins, s.
double chain_seconds(int length) {
  const std::string text = long_chain(length);
  const std::clock_t start = std::clock();
  const ValidationResult result = validate_text(text);
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  EXPECT_EQ(result.findings.count(FindingSeverity::error), 0u);
  return seconds;
}

TEST(Validate, DeepNodesWithManySkinsTakeLinearTime) {
  // Ten times as long: 100 times as much if it is quadratic.
  EXPECT_LT(chain_seconds(80'000), 30 * chain_seconds(8'000));
}

TEST(Validate, SharedBytesReadOftenAreCheckedInPart) {
  // 4,000 accessors of 65,536 bytes each, all of one view of zeros.
  std::ostringstream text;
  text << R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":65536,)"
       << R"("uri":"data:application/octet-stream;base64,)";
  for (int i = 0; i < 65536 / 3; ++i) text << "AAAA";
  text << R"(AA=="}],"bufferViews":[{"buffer":0,"byteLength":65536}],"accessors":[)";
  for (int i = 0; i < 4000; ++i) {
    text << (i > 0 ? "," : "")
         << R"({"bufferView":0,"componentType":5121,"count":65536,"type":"SCALAR"})";
  }
  text << "]}";
  const ValidationResult result = validate_text(text.str());
  EXPECT_EQ(result.findings.count(FindingSeverity::error), 0u);
  EXPECT_TRUE(result.is_partial);
}

TEST(Validate, ManyScenesOfManyNodesAreCheckedInPart) {
  constexpr int kSize = 4200;  // 2^24 visits are fewer than its square
  std::ostringstream text;
  text << R"({"asset":{"version":"2.0"},"nodes":[{"children":[)";
  for (int i = 1; i < kSize; ++i) text << (i > 1 ? "," : "") << i;
  text << "]}";
  for (int i = 1; i < kSize; ++i) text << ",{}";
  text << R"(],"scenes":[)";
  for (int i = 0; i < kSize; ++i) text << (i > 0 ? "," : "") << R"({"nodes":[0]})";
  text << "]}";
  EXPECT_TRUE(validate_text(text.str()).is_partial);
  EXPECT_FALSE(validate_text(long_chain(10)).is_partial);
}

TEST(Validate, CutFilesAreReadSafely) {
  for (const char* name : {"valid.gltf", "glb.glb", "variants.gltf", "sparse_views.gltf"}) {
    FolderReader reader{fs::path(TESSERA_INVALID_DIR)};
    const auto bytes = reader.read(name);
    ASSERT_TRUE(bytes.ok()) << bytes.status();
    for (std::size_t size = 0; size < bytes->size(); size += 7) {
      const ValidationResult result = validate_gltf(bytes->first(size), reader);
      EXPECT_GT(result.findings.count(FindingSeverity::error), 0u) << name << " " << size;
    }
  }
}

}  // namespace
}  // namespace tessera::render
