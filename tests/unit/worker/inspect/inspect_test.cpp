#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/json_schema.h"
#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"
#include "tests/support/scratch_folder.h"
#include "worker/accelerators/structures.h"
#include "worker/inspect/accelerator_table.h"
#include "worker/inspect/inspect_report.h"
#include "worker/inspect/light_through_glass.h"
#include "worker/inspect/near_vertices.h"
#include "worker/inspect/solid_check.h"

namespace tessera::render {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::GltfBuilder;
using testing::load_and_pose;
using testing::unit_quad;

/// A private folder for each test.
class InspectTest : public ::testing::Test {
 protected:
  void write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
  }

  ScratchFolder scratch_;
  const fs::path folder_ = scratch_.path();
};

TEST_F(InspectTest, ListsResourcesCountsAndFeatures) {
  GltfBuilder b;
  b.add_mesh(unit_quad(b.add_material(R"({"emissiveFactor": [1, 1, 1], "alphaMode": "BLEND"})")));
  b.add_node_with_mesh(0);
  b.add_node_with_mesh(0, R"({"translation": [2, 0, 0]})");
  b.set("/buffers/0/uri", "\"data.bin\"");
  std::string text = b.gltf();
  const std::string uri = "data:application/octet-stream;base64,";
  const std::size_t at = text.find(uri);
  const std::size_t end = text.find('"', at);
  text.replace(at, end - at, "data.bin");
  write("scene.gltf", text);
  const std::string glb = b.glb();
  write("data.bin", glb.substr(glb.find(std::string("BIN\0", 4)) + 4));
  const json report = json::parse(to_json(inspect_scene({folder_ / "scene.gltf", {}, {}})));
  EXPECT_EQ(report["schema"], "tessera.inspect/1");
  EXPECT_EQ(report["ok"], true) << report.dump(1);
  ASSERT_EQ(report["resources"].size(), 2u);
  EXPECT_EQ(report["resources"][0]["uri"], "scene.gltf");
  EXPECT_EQ(report["resources"][0]["kind"], "scene");
  EXPECT_EQ(report["resources"][1]["uri"], "data.bin");
  EXPECT_EQ(fs::path(report["resources"][1]["file"].get<std::string>()).filename(), "data.bin");
  EXPECT_EQ(report["counts"]["triangles"], 2);
  EXPECT_EQ(report["counts"]["instanced_triangles"], 4);
  EXPECT_EQ(report["counts"]["emissive_triangles"], 4);
  EXPECT_EQ(report["needs"], (json{"alpha-blend", "emissive-triangles", "instances"}));
  EXPECT_EQ(report["bounds"]["max"], (json{3, 1, 0}));
  const json& memory = report["memory"];
  EXPECT_EQ(memory["geometry_bytes"], 4 * 12 + 2 * 12) << "no textures, no coordinates";
  std::int64_t sum = 0;
  for (const char* part : {"geometry", "image", "acceleration", "light", "process"}) {
    sum += memory[std::string(part) + "_bytes"].get<std::int64_t>();
  }
  EXPECT_EQ(memory["total_bytes"], sum);
}

TEST_F(InspectTest, BadSceneNamesFileElementAndFault) {
  GltfBuilder b;
  b.add("images", R"({"uri": "bark.png"})");
  b.add_texture(0);
  b.add_mesh(unit_quad(b.add_material(R"({"emissiveTexture": {"index": 0}})")));
  b.add_node_with_mesh(0);
  write("tree.gltf", b.gltf());
  const InspectReport report = inspect_scene({folder_ / "tree.gltf", {}, {}});
  EXPECT_TRUE(report.has_errors());
  ASSERT_EQ(report.findings.size(), 1u);
  EXPECT_EQ(report.findings[0].file, "tree.gltf");
  EXPECT_EQ(report.findings[0].problem.element, "bark.png");
  EXPECT_EQ(report.findings[0].problem.severity, Problem::Severity::error);
  EXPECT_TRUE(report.findings[0].problem.message.starts_with("no such file"));
  EXPECT_EQ(json::parse(to_json(report))["counts"], nullptr);
}

TEST_F(InspectTest, MissingSceneIsNamed) {
  const InspectReport report = inspect_scene({folder_ / "none.gltf", {}, {}});
  ASSERT_EQ(report.findings.size(), 1u);
  EXPECT_EQ(report.findings[0].file, "none.gltf");
  EXPECT_EQ(report.findings[0].problem.element, "");
  EXPECT_EQ(report.findings[0].problem.message,
            "no such file (" + (folder_ / "none.gltf").string() + ")");
  fs::create_directories(folder_ / "folder.gltf");
  EXPECT_EQ(inspect_scene({folder_ / "folder.gltf", {}, {}}).findings[0].problem.element, "");
}

TEST_F(InspectTest, SkyIsListedInManifest) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  fs::create_directories(folder_ / "scene");
  write("scene/a.glb", b.glb());
  // A Radiance file of one pixel, uncompressed.
  write("sky.hdr",
        std::string("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n") + "\x80\x80\x80\x81");
  const InspectReport report = inspect_scene({folder_ / "scene/a.glb", folder_ / "sky.hdr", {}});
  EXPECT_FALSE(report.has_errors()) << to_json(report);
  ASSERT_EQ(report.resources.size(), 2u);
  EXPECT_EQ(report.resources[1].uri, "sky.hdr");
  EXPECT_EQ(report.resources[1].kind, "environment");
  EXPECT_NE(report.features.features & kFeatureEnvironmentMap, 0u);
}

TEST_F(InspectTest, UnknownCameraIsReported) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  write("a.gltf", b.gltf());
  InspectRequest request{folder_ / "a.gltf", {}, {}};
  request.settings.camera = "north";
  const InspectReport report = inspect_scene(request);
  ASSERT_TRUE(report.has_errors());
  EXPECT_EQ(report.findings.back().problem.element, "camera");
}

/// A floor at y = 0 and a light at `light`; around the point (0, 2, 0) a box of `material`.
absl::StatusOr<Scene> lamp(const std::string& material, const std::string& light) {
  GltfBuilder b;
  b.use_extension("KHR_lights_punctual");
  b.add_material("{}");
  b.add_material(material);
  b.add_mesh({.positions = {{-5, 0, -5}, {-5, 0, 5}, {5, 0, 5}, {5, 0, -5}},
              .indices = {0, 1, 2, 0, 2, 3},
              .normals = {},
              .uv = {},
              .material = 0});
  std::vector<Vec3f> corners;
  for (int i = 0; i < 8; ++i) {
    corners.push_back(
        {(i & 1) != 0 ? 1.0f : -1.0f, (i & 2) != 0 ? 3.0f : 1.0f, (i & 4) != 0 ? 1.0f : -1.0f});
  }
  b.add_mesh({.positions = corners,
              .indices = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                          2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5},
              .normals = {},
              .uv = {},
              .material = 1});
  b.set("/extensions/KHR_lights_punctual/lights", R"([{"type": "point", "name": "bulb"}])");
  b.add_node_with_mesh(0);
  b.add_node_with_mesh(1);
  b.add_node(R"({"translation": )" + light +
             R"(, "extensions": {"KHR_lights_punctual": {"light": 0}}})");
  return load_and_pose(b);
}

TEST_F(InspectTest, ValidationFindingsFollowTheSchema) {
  GltfBuilder b;
  b.add_mesh(unit_quad(b.add_material(R"({"alphaCutoff": 0.5, "metallicFactor": 1})")));
  b.add_node_with_mesh(0);
  write("scene.gltf", b.gltf());
  InspectRequest request{folder_ / "scene.gltf", {}, {}};
  EXPECT_FALSE(json::parse(to_json(inspect_scene(request))).contains("validation"));
  request.validate = true;
  const InspectReport report = inspect_scene(request);
  const json document = json::parse(to_json(report));
  EXPECT_TRUE(support::document_faults(to_json(report)).empty());
  std::map<std::string, std::string> severities;
  for (const json& each : document["validation"]["findings"]) {
    severities[each["code"].get<std::string>() + each["pointer"].get<std::string>()] =
        each["severity"];
  }
  EXPECT_EQ(severities["MATERIAL_ALPHA_CUTOFF_INVALID_MODE/materials/0/alphaCutoff"], "warning");
  EXPECT_EQ(severities["UNEXPECTED_PROPERTY/materials/0/metallicFactor"], "warning");
}

TEST_F(InspectTest, InvalidSceneHasErrorsOnlyIfValidated) {
  GltfBuilder b;
  b.add_mesh(unit_quad(b.add_material(R"({"pbrMetallicRoughness": {"metallicFactor": 7}})")));
  b.add_node_with_mesh(0);
  write("scene.gltf", b.gltf());
  InspectRequest request{folder_ / "scene.gltf", {}, {}};
  EXPECT_FALSE(inspect_scene(request).has_errors());
  request.validate = true;
  EXPECT_TRUE(inspect_scene(request).has_errors());
}

TEST(LightThroughGlass, LightInsideGlassWarns) {
  const std::string solid = R"({"extensions": {"KHR_materials_transmission":
      {"transmissionFactor": 1}, "KHR_materials_volume": {"thicknessFactor": 1}}})";
  const std::string thin =
      R"({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}})";
  const auto warnings = [](const absl::StatusOr<Scene>& scene) {
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene.ok() ? check_light_through_glass(*scene) : std::vector<Problem>();
  };
  const auto inside = warnings(lamp(solid, "[0, 2, 0]"));
  ASSERT_EQ(inside.size(), 1u);
  EXPECT_EQ(inside[0].element, "nodes[2]");
  EXPECT_NE(inside[0].message.find("bulb"), std::string::npos);
  EXPECT_TRUE(warnings(lamp(solid, "[3, 2, 0]")).empty()) << "next to the glass";
  EXPECT_TRUE(warnings(lamp(thin, "[0, 2, 0]")).empty()) << "thin glass lets it through";
  EXPECT_TRUE(warnings(lamp("{}", "[0, 2, 0]")).empty()) << "an opaque box";
}

TEST(Contents, ListCamerasVariantsAndMore) {
  testing::MemoryReader reader;
  GltfBuilder b;
  b.use_extension("KHR_materials_variants");
  b.set("/extensions/KHR_materials_variants/variants", R"([{"name": "red"}])");
  b.add("cameras", R"({"type": "perspective", "name": "wide",
                       "perspective": {"yfov": 1, "znear": 0.1}})");
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  const int input = b.add_floats("SCALAR", {0, 2.5f});
  const int output = b.add_floats("VEC3", {0, 0, 0, 1, 0, 0});
  b.add("animations", R"({"name": "go", "samplers": [{"input": )" + std::to_string(input) +
                          R"(, "output": )" + std::to_string(output) +
                          R"(}], "channels": [{"sampler": 0, "target":
                          {"node": 0, "path": "translation"}}]})");
  reader.put("scene.gltf", b.gltf());
  const auto file = load_scene_file("scene.gltf", {}, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  const SceneContents contents = (*file)->contents();
  EXPECT_EQ(contents.cameras, std::vector<std::string>{"wide"});
  EXPECT_EQ(contents.variants, std::vector<std::string>{"red"});
  EXPECT_EQ(contents.extensions_used, std::vector<std::string>{"KHR_materials_variants"});
  ASSERT_EQ(contents.animations.size(), 1u);
  EXPECT_EQ(contents.animations[0].name, "go");
  EXPECT_EQ(contents.animations[0].seconds, 2.5);
}

TEST_F(InspectTest, AcceleratorTableMatchesSchema) {
  GltfBuilder b;
  b.add_mesh(unit_quad(b.add_material("{}")));
  b.add_node_with_mesh(0);
  b.add_node_with_mesh(0, R"({"rotation": [0.6, 0, 0, 0.8], "translation": [0.5, 0.5, -0.3]})");
  write("scene.gltf", b.gltf());
  InspectRequest request{folder_ / "scene.gltf", {}, {}};
  request.examine = [&](const Scene& scene, InspectReport& report) {
    const auto table = measure_accelerators(scene, request.settings, {"", 0.001});
    ASSERT_TRUE(table.ok()) << table.status();
    report.extras = {{"accelerators", to_json(*table)},
                     {"self_intersections", overlap_report(scene)}};
  };
  const std::string text = to_json(inspect_scene(request));
  EXPECT_EQ(support::document_faults(text), std::vector<std::string>{}) << text;
  const json report = json::parse(text);
  EXPECT_EQ(report["accelerators"]["structures"].size(), 5 + accelerators::structures().size());
  for (const json& row : report["accelerators"]["structures"]) {
    for (const char* query : {"closest_hit", "any_hit"}) EXPECT_EQ(row[query]["wrong"], 0) << row;
    EXPECT_GT(row["closest_hit"]["compared"], 0);
  }
  EXPECT_EQ(report["accelerators"]["nearest"]["searches"], 8);
  EXPECT_EQ(report["accelerators"]["nearest"]["wrong"], 0);
  const json& overlaps = report["self_intersections"];
  EXPECT_EQ(overlaps["meshes"][0]["closed"], false);
  EXPECT_EQ(overlaps["meshes"][0]["open_edges"], 4);
  EXPECT_EQ(overlaps["meshes"][0]["pair_count"], 0);
  ASSERT_EQ(overlaps["instances"].size(), 1u);
  EXPECT_GT(overlaps["instances"][0]["pair_count"], 0);
}

TEST_F(InspectTest, CrackBetweenMeshesIsListed) {
  GltfBuilder b;
  b.add_mesh(unit_quad(b.add_material("{}")));
  b.add_node_with_mesh(0);
  b.add_node_with_mesh(0, R"({"translation": [1, 0.000001, 0]})");
  write("scene.gltf", b.gltf());
  InspectRequest request{folder_ / "scene.gltf", {}, {}};
  request.examine = [&](const Scene& scene, InspectReport& report) {
    report.extras = {{"vertex_distances", to_json(measure_vertex_distances(scene), scene)}};
  };
  const std::string text = to_json(inspect_scene(request));
  EXPECT_EQ(support::document_faults(text), std::vector<std::string>{}) << text;
  const json distances = json::parse(text)["vertex_distances"];
  EXPECT_EQ(distances["vertices"], 8);
  EXPECT_EQ(distances["nearest"]["searches"], 8);
  EXPECT_EQ(distances["pair_count"], 2);
  EXPECT_EQ(distances["nearest"]["wrong"], 0);
  for (const json& pair : distances["pairs"]) {
    EXPECT_NEAR(pair["distance"].get<double>(), 1e-6, 1e-7);
    EXPECT_NE(pair["nodes"][0], pair["nodes"][1]);
  }
}

TEST_F(InspectTest, SharedCornersAreNoCrack) {
  GltfBuilder b;
  b.add_mesh(unit_quad(b.add_material("{}")));
  b.add_node_with_mesh(0);
  b.add_node_with_mesh(0);
  write("scene.gltf", b.gltf());
  InspectRequest request{folder_ / "scene.gltf", {}, {}};
  request.examine = [&](const Scene& scene, InspectReport& /*report*/) {
    const VertexDistances distances = measure_vertex_distances(scene);
    EXPECT_EQ(distances.vertices, 8);
    EXPECT_EQ(distances.places, 4);
    EXPECT_TRUE(distances.near.empty());
    EXPECT_EQ(distances.median, 1);
  };
  inspect_scene(request);
}

TEST_F(InspectTest, OpenSolidWarns) {
  GltfBuilder b;
  b.set("/extensionsUsed", R"(["KHR_materials_transmission", "KHR_materials_volume"])");
  b.add_mesh(unit_quad(b.add_material(R"({"extensions": {
      "KHR_materials_transmission": {"transmissionFactor": 1},
      "KHR_materials_volume": {"thicknessFactor": 1}}})")));
  b.add_node_with_mesh(0);
  write("scene.gltf", b.gltf());
  const json report = json::parse(to_json(inspect_scene({folder_ / "scene.gltf", {}, {}})));
  EXPECT_EQ(report["ok"], true);
  EXPECT_NE(report["problems"].dump().find("open at 4 edges"), std::string::npos)
      << report["problems"];
}

}  // namespace
}  // namespace tessera::render
