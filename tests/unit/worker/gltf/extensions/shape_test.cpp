#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/json_schema.h"
#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/geometry/shapes/terrain/terrain_field.h"
#include "worker/scene/features.h"

namespace tessera::render {
namespace {

using testing::GltfBuilder;
using testing::load_and_pose;
using testing::unit_quad;

std::string shape_node(const std::string& shape, const std::string& more = "") {
  return R"({"extensions": {"TESSERA_shape": )" + shape + "}" + more + "}";
}

std::string csg_node(const std::string& operation, const std::string& children) {
  return R"({"children": )" + children + R"(, "extensions": {"TESSERA_csg": {"operation": ")" +
         operation + R"("}}})";
}

absl::StatusOr<Scene> with_shape(const std::string& shape) {
  GltfBuilder b;
  b.use_extension("TESSERA_shape");
  b.add_node(shape_node(shape));
  return load_and_pose(b);
}

TEST(Shapes, AreInstancesWithMaterial) {
  GltfBuilder b;
  b.use_extension("TESSERA_shape");
  b.add_material(R"({"name": "red"})");
  b.add_node(shape_node(R"({"type": "sphere", "radius": 2, "material": 0})",
                        R"(, "translation": [5, 0, 0])"));
  b.add_node(shape_node(R"({"type": "torus"})"));
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->instances.size(), 2u);
  const Mesh& ball = scene->meshes[0];
  ASSERT_NE(ball.shape, nullptr);
  EXPECT_EQ(ball.shape->bounds.hi, (Vec3f{2, 2, 2}));
  EXPECT_EQ(ball.primitives[0].material, 0);
  EXPECT_EQ(scene->meshes[1].primitives[0].material, 1);  // glTF's default material
  // From the torus at -1.25 to the sphere at 7: the centre is that of the visible objects.
  EXPECT_NEAR(scene->center.x, (7 - 1.25) / 2, 1e-6);
  const std::uint64_t features = features_of(*scene).features;
  EXPECT_NE(features & kFeatureShapes, 0u);
  EXPECT_EQ(features & kFeaturePlanes, 0u);
  EXPECT_EQ(features & kFeatureCsg, 0u);
}

TEST(Shapes, AllTypesAreRead) {
  for (const char* shape :
       {R"({"type": "sphere"})", R"({"type": "ellipsoid", "radii": [1, 2, 3]})",
        R"({"type": "disc", "radius": 2})", R"({"type": "rectangle", "size": [1, 2]})",
        R"({"type": "box", "size": [1, 2, 3]})", R"({"type": "cylinder", "capped": false})",
        R"({"type": "cone", "height": 3})", R"({"type": "paraboloid"})",
        R"({"type": "hyperboloid", "waist": 0.5})",
        R"({"type": "two-sheet-hyperboloid", "gap": 0.5})",
        R"({"type": "quadric", "coefficients": [1, 0, 0, 0, 0, 0, 0, 0, 0, -1]})",
        R"({"type": "torus", "radius": 2, "tube": 0.5, "extras": {}})", R"({"type": "plane"})"}) {
    const auto scene = with_shape(shape);
    ASSERT_TRUE(scene.ok()) << shape << scene.status();
    EXPECT_EQ(scene->instances.size(), 1u) << shape;
  }
}

TEST(Shapes, ErrorsNameElementAndFault) {
  struct Case {
    const char *shape, *element, *fault;
  };
  for (const Case& c : std::vector<Case>{
           {R"({"type": "ball"})", "TESSERA_shape.type", "\"ball\" is not one of sphere"},
           {R"({"type": "sphere", "radius": 0})", "TESSERA_shape.radius", "0 is not in"},
           {R"({"type": "sphere", "radius": "1"})", "TESSERA_shape.radius", "must be a number"},
           {R"({"type": "sphere", "height": 1})", "TESSERA_shape.height", "unknown property"},
           {R"({"type": "plane", "size": [1, 1]})", "TESSERA_shape.size", "unknown property"},
           {R"({"type": "box", "size": [1, 1]})", "TESSERA_shape.size", "array of 3 numbers"},
           {R"({"type": "box", "size": [1, -1, 1]})", "TESSERA_shape.size[1]", "-1 is not in"},
           {R"({"type": "torus", "tube": 1})", "TESSERA_shape.tube", "below the radius"},
           {R"({"type": "hyperboloid", "waist": 1})", "TESSERA_shape.waist", "below the radius"},
           {R"({"type": "two-sheet-hyperboloid", "gap": 2})", "TESSERA_shape.gap",
            "below the height"},
           {R"({"type": "quadric", "min": [0, 1, 0]})", "TESSERA_shape.max", "above min"},
           {R"({"type": "quadric", "max": [1e19, 1, 1]})", "TESSERA_shape.min", "lies beyond"},
           {R"({"type": "sphere", "material": 7})", "TESSERA_shape.material", "7 is not the index"},
       }) {
    const absl::Status status = with_shape(c.shape).status();
    const std::string message(status.message());
    EXPECT_NE(message.find(std::string("nodes[0].extensions.") + c.element), std::string::npos)
        << message;
    EXPECT_NE(message.find(c.fault), std::string::npos) << message;
  }
}

TEST(Shapes, NeedNodeWithoutMesh) {
  GltfBuilder b;
  b.use_extension("TESSERA_shape");
  b.add_mesh(unit_quad());
  b.add_node(shape_node(R"({"type": "sphere"})", R"(, "mesh": 0)"));
  EXPECT_NE(load_and_pose(b).status().message().find("already has a mesh"), std::string::npos);
}

absl::StatusOr<Scene> with_blobs(const std::string& blobs, const std::string& more = "") {
  GltfBuilder b;
  b.use_extension("TESSERA_blobs");
  b.use_extension("TESSERA_shape");
  b.add_node(R"({"extensions": {"TESSERA_blobs": )" + blobs + more + "}}");
  return load_and_pose(b);
}

TEST(Planes, CountAsTheirOriginInBounds) {
  GltfBuilder b;
  b.use_extension("TESSERA_shape");
  b.add_node(shape_node(R"({"type": "sphere"})", R"(, "translation": [5, 3, 0])"));
  b.add_node(shape_node(R"({"type": "plane"})", R"(, "translation": [5, -2, 0])"));
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->bounds_max + scene->center, (Vec3d{6, 4, 1}));
  EXPECT_EQ(scene->bounds_min + scene->center, (Vec3d{4, -2, -1}));
  EXPECT_LT(length(scene->camera.camera_to_world.translation), 20);  // frames the sphere
  EXPECT_EQ(features_of(*scene).features & (kFeatureShapes | kFeaturePlanes),
            kFeatureShapes | kFeaturePlanes);
}

TEST(Planes, EmissionGivesAWarning) {
  const auto warned = [](const char* type) {
    GltfBuilder b;
    b.use_extension("TESSERA_shape");
    b.add_material(R"({"emissiveFactor": [1, 1, 1]})");
    b.add_node(shape_node(std::string(R"({"type": ")") + type + R"(", "material": 0})"));
    testing::MemoryReader reader;
    reader.put("scene.gltf", b.gltf());
    const auto file = load_scene_file("scene.gltf", {}, reader);
    EXPECT_TRUE((*file)->pose({}, 0).ok());
    const auto& problems = (*file)->problems();
    return std::any_of(problems.begin(), problems.end(), [](const Problem& p) {
      return p.element == "nodes[0]" && p.message.find("no finite power") != std::string::npos;
    });
  };
  EXPECT_TRUE(warned("plane"));
  EXPECT_FALSE(warned("disc"));
}

TEST(Blobs, AreReadAsShape) {
  const auto scene = with_blobs(R"({"elements": [{"radius": 2},
      {"center": [9, 0, 0], "radii": [1, 2, 3], "strength": 4}], "threshold": 1, "extras": {}})");
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->instances.size(), 1u);
  const Shape& shape = *scene->meshes[0].shape;
  EXPECT_TRUE(shape.closed());
  // The first does not reach the threshold; the second does at (1 - r^2)^2 = 1 / 4.
  const double reach = std::sqrt(0.5);
  EXPECT_NEAR(shape.bounds.lo.x, 9 - reach, 1e-5);
  EXPECT_NEAR(shape.bounds.hi.z, 3 * reach, 1e-5);
  EXPECT_NE(features_of(*scene).features & kFeatureShapes, 0u);
}

TEST(Blobs, ErrorsNameElementAndFault) {
  struct Case {
    const char *blobs, *element, *fault;
  };
  for (const Case& c : std::vector<Case>{
           {"{}", ".elements", "must be 1 to 10000 blobs"},
           {R"({"elements": []})", ".elements", "must be 1 to 10000 blobs"},
           {R"({"elements": [{}], "threshold": 0})", ".threshold", "0 is not in"},
           {R"({"elements": [{}], "treshold": 1})", ".treshold", "unknown property"},
           {R"({"elements": [{}, {"radius": -1}]})", ".elements[1].radius", "-1 is not in"},
           {R"({"elements": [{"radii": [1, 1, 0]}]})", ".elements[0].radii[2]", "0 is not in"},
           {R"({"elements": [{"radii": [1, 1, 1], "radius": 1}]})", ".elements[0].radii",
            "not allowed together with radius"},
           {R"({"elements": [{"center": [0, 1e19, 0]}]})", ".elements[0].center[1]", "is not in"},
           {R"({"elements": [{"strength": 1e7}]})", ".elements[0].strength", "is not in"},
           {R"({"elements": [{"centre": [0, 0, 0]}]})", ".elements[0].centre", "unknown property"},
           {R"({"elements": [{}], "material": 3})", ".material", "3 is not the index"},
       }) {
    const std::string message(with_blobs(c.blobs).status().message());
    EXPECT_NE(message.find(std::string("nodes[0].extensions.TESSERA_blobs") + c.element + ": "),
              std::string::npos)
        << message;
    EXPECT_NE(message.find(c.fault), std::string::npos) << message;
  }
  const auto both = with_blobs(R"({"elements": [{}]})", R"(, "TESSERA_shape": {"type": "box"})");
  EXPECT_NE(both.status().message().find("already has a TESSERA_shape"), std::string::npos);
}

absl::StatusOr<Scene> with_terrain(const std::string& terrain, const std::string& more = "") {
  GltfBuilder b;
  b.use_extension("TESSERA_terrain");
  b.use_extension("TESSERA_blobs");
  b.add_node(R"({"extensions": {"TESSERA_terrain": )" + terrain + more + "}}");
  return load_and_pose(b);
}

TEST(Terrain, IsReadAsShape) {
  const auto scene = with_terrain(R"({"pattern": "fbm", "size": [4, 2], "height": 3, "depth": 0.5,
      "scale": 2, "offset": [5, 6], "seed": 7, "octaves": 3, "lacunarity": 3, "gain": 0.25,
      "detail": {"from": [1, 2, 3], "angle": 0.5}, "extras": {}})");
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Shape& shape = *scene->meshes[0].shape;
  EXPECT_TRUE(shape.closed());
  EXPECT_EQ(shape.bounds.lo, (Vec3f{-2, -0.5f, -1}));
  const TerrainForm& form = shape.terrain->form();
  EXPECT_EQ(form.pattern, TerrainForm::Pattern::fbm);
  EXPECT_EQ(form.size, (Vec2d{4, 2}));
  EXPECT_EQ(form.offset, (Vec2d{5, 6}));
  EXPECT_EQ(form.seen_from, (Vec3d{1, 2, 3}));
  EXPECT_EQ(form.height, 3);
  EXPECT_EQ(form.scale, 2);
  EXPECT_EQ(form.seed, 7u);
  EXPECT_EQ(form.octaves, 3);
  EXPECT_EQ(form.lacunarity, 3);
  EXPECT_EQ(form.gain, 0.25);
  EXPECT_EQ(form.spot_angle, 0.5);
  EXPECT_NE(features_of(*scene).features & kFeatureShapes, 0u);
  const auto open = with_terrain(R"({"pattern": "waves", "octaves": 0})");
  ASSERT_TRUE(open.ok()) << open.status();
  EXPECT_FALSE(open->meshes[0].shape->closed());
}

TEST(Terrain, ErrorsNameElementAndFault) {
  struct Case {
    const char *terrain, *element, *fault;
  };
  for (const Case& c : std::vector<Case>{
           {"{}", ".pattern", "is not one of fbm, ridged, waves"},
           {R"({"pattern": "hills"})", ".pattern", "\"hills\" is not one of"},
           {R"({"pattern": "fbm", "size": [1, 0]})", ".size[1]", "0 is not in"},
           {R"({"pattern": "fbm", "size": [1]})", ".size", "array of 2 numbers"},
           {R"({"pattern": "fbm", "height": 0})", ".height", "0 is not in"},
           {R"({"pattern": "fbm", "depth": -1})", ".depth", "-1 is not in"},
           {R"({"pattern": "fbm", "octaves": 25})", ".octaves", "25"},
           {R"({"pattern": "fbm", "octaves": 24, "lacunarity": 4})", ".octaves",
            "the finest octave has"},
           {R"({"pattern": "fbm", "gain": 2})", ".gain", "2 is not in"},
           {R"({"pattern": "fbm", "detail": {"angle": 0}})", ".detail.angle", "0 is not in"},
           {R"({"pattern": "fbm", "detail": {"from": [1e19, 0, 0]}})", ".detail.from", "beyond"},
           {R"({"pattern": "fbm", "detail": {"to": 1}})", ".detail.to", "unknown property"},
           {R"({"pattern": "fbm", "scales": 1})", ".scales", "unknown property"},
           {R"({"pattern": "fbm", "material": 3})", ".material", "3 is not the index"},
       }) {
    const std::string message(with_terrain(c.terrain).status().message());
    EXPECT_NE(message.find(std::string("nodes[0].extensions.TESSERA_terrain") + c.element + ": "),
              std::string::npos)
        << message;
    EXPECT_NE(message.find(c.fault), std::string::npos) << message;
  }
  const auto both =
      with_terrain(R"({"pattern": "fbm"})", R"(, "TESSERA_blobs": {"elements": [{}]})");
  EXPECT_NE(both.status().message().find("already has a TESSERA_blobs"), std::string::npos);
}

TEST(Csg, IsReadAsPostfix) {
  GltfBuilder b;
  b.use_extension("TESSERA_shape");
  b.use_extension("TESSERA_csg");
  b.add_node(csg_node("subtraction", "[1, 2]"));
  b.add_node(shape_node(R"({"type": "box"})"), false);
  b.add_node(R"({"children": [3, 4], "translation": [1, 0, 0]})", false);  // a group: their union
  b.add_node(shape_node(R"({"type": "sphere"})"), false);
  b.add_node(shape_node(R"({"type": "sphere"})"), false);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->solids.size(), 1u);
  const CsgSolid& solid = scene->solids[0];
  EXPECT_EQ(solid.first, 0u);
  EXPECT_EQ(solid.count, 3u);
  ASSERT_EQ(solid.steps.size(), 5u);
  EXPECT_TRUE(solid.steps[2].is_operand);
  EXPECT_EQ(solid.steps[2].number, 2u);
  EXPECT_EQ(solid.steps[3].operation, CsgOperation::unite);
  EXPECT_EQ(solid.steps[3].number, 2u);
  EXPECT_EQ(solid.steps[4].operation, CsgOperation::subtract);
  for (const Instance& instance : scene->instances) EXPECT_TRUE(instance.operand);
  EXPECT_NE(features_of(*scene).features & kFeatureCsg, 0u);
}

TEST(Csg, OpenOperandsAreRejected) {
  const auto refused = [](const std::string& operand, const std::string& fault) {
    GltfBuilder b;
    b.use_extension("TESSERA_shape");
    b.use_extension("TESSERA_csg");
    b.use_extension("KHR_node_visibility");
    b.add_mesh(unit_quad());
    b.add_node(csg_node("union", "[1, 2]"));
    b.add_node(shape_node(R"({"type": "box"})"), false);
    b.add_node(operand, false);
    const std::string message(load_and_pose(b).status().message());
    EXPECT_NE(message.find("nodes[2]: "), std::string::npos) << message;
    EXPECT_NE(message.find(fault), std::string::npos) << message;
  };
  refused(shape_node(R"({"type": "disc"})"), "the shape is open");
  refused(shape_node(R"({"type": "cylinder", "capped": false})"), "the shape is open");
  refused(R"({"mesh": 0})", "the mesh is open at 4 edges");
  refused(R"({"translation": [1, 0, 0]})", "needs a mesh, shape or children");
}

TEST(Csg, ErrorsNameElementAndFault) {
  GltfBuilder b;
  b.use_extension("TESSERA_csg");
  b.add_node(csg_node("minus", "[]"));
  const std::string message(load_and_pose(b).status().message());
  EXPECT_NE(message.find("nodes[0].extensions.TESSERA_csg.operation"), std::string::npos)
      << message;
  EXPECT_NE(message.find("not one of union"), std::string::npos) << message;
}

TEST(Schemas, AcceptExampleScenes) {
  for (const char* name : {"shapes", "csg", "blobs", "terrain", "planes"}) {
    std::ifstream file(std::string(TESSERA_SOURCE_DIR) + "/tests/scenes/" + name + ".gltf");
    int checked = 0;
    const auto document = nlohmann::json::parse(file);
    for (const auto& node : document.at("nodes")) {
      for (const char* extension :
           {"TESSERA_shape", "TESSERA_csg", "TESSERA_blobs", "TESSERA_terrain"}) {
        const auto extensions = node.value("extensions", nlohmann::json::object());
        if (!extensions.contains(extension)) continue;
        ++checked;
        const auto faults =
            support::schema_faults(support::read_schema(extension), extensions.at(extension));
        EXPECT_TRUE(faults.empty()) << name << ": " << faults.front();
      }
    }
    EXPECT_GE(checked, 3) << name;
  }
}

}  // namespace
}  // namespace tessera::render
