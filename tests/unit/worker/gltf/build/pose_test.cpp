#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/gltf/model/hierarchy.h"

namespace tessera::render {
namespace {

using testing::GltfBuilder;
using testing::load_and_pose;
using testing::MemoryReader;
using testing::unit_quad;

Vec3d world_of(const Scene& scene, std::size_t instance, const Vec3f& p) {
  return transform_point(scene.instances[instance].object_to_world, Vec3d(p)) + scene.center;
}

void expect_point(const Vec3d& a, const Vec3d& b, double tolerance = 1e-12) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

TEST(Nodes, TransformsComposeDownTree) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  // 90 degrees about +y takes +x to -z.
  b.add_node(R"({"children": [1], "translation": [10, 0, 0], "scale": [2, 2, 2],
                 "rotation": [0, 0.7071067811865476, 0, 0.7071067811865476]})");
  b.add_node(R"({"mesh": 0, "translation": [1, 0, 0]})", false);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  // (1,1,0) -> +1 x -> (2,1,0) -> scale -> (4,2,0) -> rotate -> (0,2,-4) -> +10 x.
  expect_point(world_of(*scene, 0, {1, 1, 0}), {10, 2, -4});
}

TEST(Nodes, SixtyFourLevelsComposeExactly) {  // hard case 29
  constexpr int kLevels = 64;
  const Vec3d axis = {0.48, 0.6, 0.64};  // of length 1
  GltfBuilder b;
  b.add_mesh(unit_quad());
  Vec3d expected = {1, 1, 0};
  for (int level = kLevels - 1; level >= 0; --level) {  // from the leaf: scale, rotate, move
    const double half = 0.05 + 0.01 * level, scale = level % 2 == 0 ? 1.25 : 0.8;
    const Vec3d p = expected * scale, move = {0.5, -0.25, 0.125 * level};
    // Rodrigues' formula, by an angle of twice `half`.
    expected = p * std::cos(2 * half) + cross(axis, p) * std::sin(2 * half) +
               axis * (dot(axis, p) * (1 - std::cos(2 * half))) + move;
  }
  for (int level = 0; level < kLevels; ++level) {
    const double half = 0.05 + 0.01 * level, scale = level % 2 == 0 ? 1.25 : 0.8;
    const Vec3d q = axis * std::sin(half);
    nlohmann::json node = {{"translation", {0.5, -0.25, 0.125 * level}},
                           {"rotation", {q.x, q.y, q.z, std::cos(half)}},
                           {"scale", {scale, scale, scale}}};
    if (level + 1 < kLevels) node["children"] = {level + 1};
    if (level + 1 == kLevels) node["mesh"] = 0;
    b.add_node(node.dump(), level == 0);
  }
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->instances.size(), 1u) << "a leaf this deep must not be lost";
  // Each level rounds about 20 times, by 2^-53 of the translations of up to 64 levels (4 each).
  expect_point(world_of(*scene, 0, {1, 1, 0}), expected, kLevels * 20 * 0x1p-53 * kLevels * 4);
}

TEST(Nodes, MatrixEqualsTranslationRotationScale) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0, R"({"matrix": [0, 0, -2, 0, 0, 3, 0, 0, 4, 0, 0, 0, 5, 6, 7, 1]})");
  b.add_node_with_mesh(0, R"({"translation": [5, 6, 7], "scale": [2, 3, 4],
                              "rotation": [0, 0.7071067811865476, 0, 0.7071067811865476]})");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  for (const Vec3f p : {Vec3f{1, 0, 0}, Vec3f{0, 1, 0}, Vec3f{1, 1, 0}}) {
    expect_point(world_of(*scene, 0, p), world_of(*scene, 1, p));
  }
  expect_point(world_of(*scene, 0, {1, 1, 0}), {5, 9, 5});
}

TEST(Nodes, InstancesShareMeshInDepthFirstOrder) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node(R"({"mesh": 0, "children": [3, 2]})");
  b.add_node(R"({"mesh": 0})");
  b.add_node(R"({"mesh": 0})", false);
  b.add_node(R"({"mesh": 0, "children": [4]})", false);
  b.add_node(R"({"mesh": 0})", false);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes.size(), 1u);
  std::vector<int> nodes;
  for (const Instance& i : scene->instances) nodes.push_back(i.node);
  EXPECT_EQ(nodes, (std::vector<int>{0, 3, 4, 2, 1}));
}

TEST(Nodes, HiddenNodeHidesChildren) {
  GltfBuilder b;
  b.use_extension("KHR_node_visibility");
  b.add_mesh(unit_quad());
  b.add_node(R"({"mesh": 0, "children": [1],
                 "extensions": {"KHR_node_visibility": {"visible": false}}})");
  b.add_node(R"({"mesh": 0})", false);
  b.add_node(R"({"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": true}}})");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->instances.size(), 1u);
  EXPECT_EQ(scene->instances[0].node, 2);
}

TEST(Nodes, SingularTransformWarnsAndDropsNode) {
  for (const char* scale : {"[0, 0, 0]", "[1, 1, 0]", "[1e-200, 1, 1e-200]"}) {
    testing::MemoryReader reader;
    GltfBuilder b;
    b.add_mesh(unit_quad());
    b.add_node_with_mesh(0, std::string(R"({"scale": )") + scale + "}");
    b.add_node_with_mesh(0);
    reader.put("scene.gltf", b.gltf());
    const auto file = load_scene_file("scene.gltf", {}, reader);
    ASSERT_TRUE(file.ok()) << file.status();
    const auto scene = (*file)->pose({}, 0);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ(scene->instances.size(), 1u);
    const auto& problems = (*file)->problems();
    EXPECT_TRUE(std::any_of(problems.begin(), problems.end(), [](const Problem& problem) {
      return problem.element == "nodes[0]" && problem.message.starts_with("its transform");
    }));
  }
}

TEST(Nodes, NegativeDeterminantFlipsWinding) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node(R"({"mesh": 0, "scale": [-1, 1, 1], "children": [1, 2]})");
  b.add_node(R"({"mesh": 0})", false);
  b.add_node(R"({"mesh": 0, "scale": [1, -2, 1]})", false);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok());
  EXPECT_TRUE(scene->instances[0].flips_winding);
  EXPECT_TRUE(scene->instances[1].flips_winding);
  EXPECT_FALSE(scene->instances[2].flips_winding);
}

TEST(Instancing, PlacesOneInstancePerElement) {
  GltfBuilder b;
  b.use_extension("EXT_mesh_gpu_instancing", true);
  b.add_mesh(unit_quad());
  const int t = b.add_vec3({{1, 0, 0}, {0, 2, 0}});
  const int r = b.add_vec4({{0, 0, 0, 1}, {0, 0, 1, 0}});  // the second: 180 degrees about z
  const int s = b.add_vec3({{1, 1, 1}, {3, 3, 3}});
  b.add_node_with_mesh(0, R"({"translation": [0, 0, 5], "extensions": {"EXT_mesh_gpu_instancing":
      {"attributes": {"TRANSLATION": )" +
                              std::to_string(t) + R"(, "ROTATION": )" + std::to_string(r) +
                              R"(, "SCALE": )" + std::to_string(s) + "}}}}");
  b.add_node_with_mesh(0);
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->instances.size(), 3u);
  EXPECT_EQ(scene->meshes.size(), 1u);
  EXPECT_EQ(scene->instances[1].node, 0);
  EXPECT_EQ(scene->instances[2].node, 1);
  expect_point(world_of(*scene, 0, {1, 1, 0}), {2, 1, 5});
  expect_point(world_of(*scene, 1, {1, 1, 0}), {-3, -1, 5});
}

/// A small room with a camera and a light, all below one node translated by `t`.
std::string moved_room(const Vec3d& t, double scale = 1) {
  GltfBuilder b;
  b.use_extension("KHR_lights_punctual");
  b.add_mesh(unit_quad());
  b.set("/extensions/KHR_lights_punctual/lights", R"([{"type": "point", "intensity": 5}])");
  b.add("cameras", R"({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}})");
  const auto number = [](double v) { return std::to_string(v); };
  b.add_node(R"({"children": [1, 2, 3, 4], "translation": [)" + number(t.x) + "," + number(t.y) +
             "," + number(t.z) + R"(], "scale": [)" + number(scale) + "," + number(scale) + "," +
             number(scale) + "]}");
  b.add_node(R"({"mesh": 0, "translation": [-0.5, 0.25, -3]})", false);
  b.add_node(R"({"mesh": 0, "rotation": [0.6, 0, 0, 0.8], "scale": [2, 4, 0.5]})", false);
  b.add_node(R"({"camera": 0, "translation": [0.125, 0.5, 4]})", false);
  b.add_node(R"({"extensions": {"KHR_lights_punctual": {"light": 0}},
                 "translation": [1, 2, 0.75]})",
             false);
  return b.gltf();
}

TEST(Recentring, TranslatedSceneHasSameBits) {
  // Rotation (0.6, 0, 0, 0.8) is not dyadic, but its matrix is the same at every translation; the
  // sums stay exact for translations of few bits.
  const auto here = load_and_pose(moved_room({0, 0, 0}));
  const auto far = load_and_pose(moved_room({1048576, -524288, 65536}));
  ASSERT_TRUE(here.ok() && far.ok()) << here.status() << far.status();
  ASSERT_EQ(here->instances.size(), far->instances.size());
  // Bounds of the unrotated quad, the camera and the light are exact sums.
  EXPECT_EQ(here->instances[0].object_to_world.rows, far->instances[0].object_to_world.rows);
  EXPECT_EQ(here->camera.camera_to_world.rows, far->camera.camera_to_world.rows);
  const Vec3d moved = far->center - here->center;
  EXPECT_NEAR(moved.x, 1048576, 1e-9);
  // Only the rotated quad's corner at 1e6 rounds: one ulp there is 1.2e-10.
  expect_point(here->camera.camera_to_world.translation, far->camera.camera_to_world.translation,
               1e-9);
}

TEST(Recentring, IsExactWhenSumsAreExact) {
  const auto scene_at = [](const Vec3d& t) {
    GltfBuilder b;
    b.add_mesh(unit_quad());
    b.add("cameras", R"({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}})");
    const auto n = [](double v) { return std::to_string(v); };
    b.add_node(R"({"children": [1, 2], "translation": [)" + n(t.x) + "," + n(t.y) + "," + n(t.z) +
               "]}");
    b.add_node(R"({"mesh": 0, "translation": [-0.5, 0.25, -3.0625], "scale": [2, 4, 0.5]})", false);
    b.add_node(R"({"camera": 0, "translation": [0.125, 0.5, 4]})", false);
    return load_and_pose(b);
  };
  const auto here = scene_at({0, 0, 0});
  const auto far = scene_at({1000000, 1000000, 1000000});
  ASSERT_TRUE(here.ok() && far.ok());
  EXPECT_EQ(here->instances[0].object_to_world, far->instances[0].object_to_world);
  EXPECT_EQ(here->instances[0].world_to_object, far->instances[0].world_to_object);
  EXPECT_EQ(here->camera.camera_to_world, far->camera.camera_to_world);
  EXPECT_EQ(here->bounds_min, far->bounds_min);
  EXPECT_EQ(here->bounds_max, far->bounds_max);
}

TEST(Recentring, ScalesExactlyWithPowersOfTwo) {
  const auto one = load_and_pose(moved_room({0, 0, 0}));
  const auto big = load_and_pose(moved_room({0, 0, 0}, 1024));
  ASSERT_TRUE(one.ok() && big.ok());
  EXPECT_EQ(big->center, one->center * 1024.0);
  EXPECT_EQ(big->bounds_max, one->bounds_max * 1024.0);
  EXPECT_EQ(big->camera.camera_to_world.rows, one->camera.camera_to_world.rows);
  EXPECT_EQ(big->camera.camera_to_world.translation,
            one->camera.camera_to_world.translation * 1024.0);
  EXPECT_EQ(big->lights[0].position, one->lights[0].position * 1024.0);
}

TEST(Cameras, AreSelectedByNameOrIndex) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  b.add("cameras", R"({"type": "perspective", "name": "wide",
                       "perspective": {"yfov": 1.5, "znear": 0.1, "aspectRatio": 9}})");
  b.add("cameras", R"({"type": "orthographic", "name": "flat",
                       "orthographic": {"xmag": 9, "ymag": 3, "znear": 0, "zfar": 50}})");
  b.add_node(R"({"camera": 1, "name": "side", "scale": [5, 5, 5]})");
  b.add_node(R"({"camera": 0, "translation": [0, 0, 9]})");
  contract::RenderSettings settings;
  const auto name_of = [&](const char* wanted) {
    settings.camera = wanted;
    const auto scene = load_and_pose(b, settings);
    return scene.ok() ? scene->camera.name : std::string(scene.status().message());
  };
  EXPECT_EQ(name_of(""), "flat");
  EXPECT_EQ(name_of("wide"), "wide");
  EXPECT_EQ(name_of("side"), "flat");
  EXPECT_EQ(name_of("0"), "wide");
  EXPECT_EQ(name_of("1"), "flat");
  EXPECT_NE(name_of("nobody").find("\"nobody\" not found"), std::string::npos);
  settings.camera = "flat";
  const auto scene = load_and_pose(b, settings);
  EXPECT_EQ(scene->camera.kind, Camera::Kind::orthographic);
  EXPECT_EQ(scene->camera.ymag, 3);
  EXPECT_EQ(scene->camera.zfar, 50);
  // The node's scale does not affect the camera.
  EXPECT_EQ(scene->camera.camera_to_world.rows[0], (Vec3d{1, 0, 0}));
}

TEST(Cameras, DefaultCameraFramesScene) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0, R"({"translation": [100, 200, 300], "scale": [6, 8, 1]})");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok());
  // Half the diagonal of 6 x 8 is 5; the direction is normalize(0.5, 0.35, 1).
  const double length = std::sqrt(0.25 + 0.35 * 0.35 + 1);
  const double distance = 5 / std::sin(20 * std::acos(-1.0) / 180);
  expect_point(scene->camera.camera_to_world.translation,
               {distance * 0.5 / length, distance * 0.35 / length, distance / length}, 1e-12);
  EXPECT_NEAR(scene->camera.yfov, 40 * std::acos(-1.0) / 180, 1e-15);
  // It looks at the centre, +y up, and its axes are right-handed and orthonormal.
  const Affine3d& m = scene->camera.camera_to_world;
  expect_point(transform_point(m, Vec3d{0, 0, -distance}), {0, 0, 0}, 1e-12);
  EXPECT_NEAR(determinant(m), 1, 1e-15);
  EXPECT_EQ(m.rows[1].x, 0);  // the x axis is level
  EXPECT_GT(m.rows[1].y, 0);
}

/// The sphere around the scene's box touches the narrower pair of sides of the pyramid of view.
TEST(Cameras, DefaultCameraFramesScenePortrait) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0, R"({"scale": [6, 8, 1]})");
  contract::RenderSettings settings;
  for (const auto& [width, height] : {std::pair(60, 240), std::pair(240, 60), std::pair(50, 50)}) {
    settings.width = width;
    settings.height = height;
    const auto scene = load_and_pose(b, settings);
    ASSERT_TRUE(scene.ok());
    const double tangent = std::tan(scene->camera.yfov / 2) * std::min(1.0, 1.0 * width / height);
    EXPECT_NEAR(length(scene->camera.camera_to_world.translation) * std::sin(std::atan(tangent)), 5,
                1e-12);
  }
}

/// Its frame follows what is visible, not the box of a turned box.
TEST(Cameras, DefaultCameraFramesTurnedScene) {
  GltfBuilder b;
  b.use_extension("TESSERA_shape");
  b.add_node(R"({"rotation": [0, 0.38268343, 0, 0.92387953],
                 "extensions": {"TESSERA_shape": {"type": "sphere", "radius": 1}}})");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok());
  const double sine = std::sin(scene->camera.yfov / 2);
  EXPECT_NEAR(length(scene->camera.camera_to_world.translation) * sine, std::sqrt(3), 1e-6);
}

TEST(Cameras, ClippedSceneWarns) {
  const auto warning_of = [](const char* lens, double distance) {
    MemoryReader reader;
    GltfBuilder b;
    b.add_mesh(unit_quad());
    b.add_node_with_mesh(0);
    b.add("cameras", lens);
    b.add_node(nlohmann::json{{"camera", 0}, {"translation", {0, 0, distance}}}.dump());
    reader.put("scene.gltf", b.gltf());
    const auto file = load_scene_file("scene.gltf", {}, reader);
    EXPECT_TRUE((*file)->pose({}, 0).ok());
    for (const Problem& problem : (*file)->problems()) {
      if (problem.element == "cameras[0]") return problem.message;
    }
    return std::string();
  };
  constexpr const char* kPerspective =
      R"({"type": "perspective", "perspective": {"yfov": 1, "znear": 2, "zfar": 10}})";
  constexpr const char* kOrthographic = R"({"type": "orthographic",
      "orthographic": {"xmag": 1, "ymag": 1, "znear": 2, "zfar": 10}})";
  for (const char* lens : {kPerspective, kOrthographic}) {  // the mesh is at z = 0
    EXPECT_NE(warning_of(lens, 1.75).find("nearer than znear, 2 m, and the scene ends at 1.75 m"),
              std::string::npos);
    EXPECT_EQ(warning_of(lens, 2), "");
    EXPECT_EQ(warning_of(lens, 10), "");
    EXPECT_NE(warning_of(lens, 11).find("farther than zfar, 10 m, and the scene begins at 11 m"),
              std::string::npos);
    EXPECT_EQ(warning_of(lens, -1), "");  // behind the camera, which an animation may turn
  }
}

TEST(Lights, FollowNodeTransform) {
  GltfBuilder b;
  b.use_extension("KHR_lights_punctual");
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  b.set("/extensions/KHR_lights_punctual/lights", R"([
    {"type": "spot", "color": [1, 0.5, 0.25], "intensity": 8, "range": 20,
     "spot": {"innerConeAngle": 0.5, "outerConeAngle": 1.0}},
    {"type": "directional", "intensity": 3}, {"type": "point", "name": "bulb"}])");
  // -90 degrees about x turns -z into -y.
  b.add_node(R"({"translation": [1, 5, 2], "scale": [7, 7, 7],
                 "rotation": [-0.7071067811865476, 0, 0, 0.7071067811865476],
                 "extensions": {"KHR_lights_punctual": {"light": 0}}})");
  b.add_node(R"({"extensions": {"KHR_lights_punctual": {"light": 1}}})");
  b.add_node(R"({"extensions": {"KHR_lights_punctual": {"light": 2}}})");
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->lights.size(), 3u);
  const PunctualLight& spot = scene->lights[0];
  EXPECT_EQ(spot.kind, PunctualLight::Kind::spot);
  EXPECT_EQ(spot.intensity, (Vec3f{8, 4, 2}));
  EXPECT_EQ(spot.range, 20.0f);
  EXPECT_NEAR(spot.cos_inner, std::cos(0.5), 1e-7);
  EXPECT_NEAR(spot.cos_outer, std::cos(1.0), 1e-7);
  expect_point(spot.position + scene->center, {1, 5, 2});
  expect_point(Vec3d(spot.direction), {0, -1, 0}, 1e-7);
  EXPECT_EQ(scene->lights[1].kind, PunctualLight::Kind::directional);
  expect_point(Vec3d(scene->lights[1].direction), {0, 0, -1});
  EXPECT_EQ(scene->lights[2].name, "bulb");
  EXPECT_EQ(scene->lights[2].intensity, (Vec3f{1, 1, 1}));
  EXPECT_FALSE(scene->has_environment);
}

TEST(Environment, DefaultSkyIsWhiteWithNote) {
  testing::MemoryReader reader;
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  reader.put("scene.gltf", b.gltf());
  const auto file = load_scene_file("scene.gltf", {}, reader);
  const auto scene = (*file)->pose({}, 0);
  EXPECT_TRUE(scene->has_environment);
  EXPECT_EQ(scene->environment.constant, (Vec3f{1, 1, 1}));
  ASSERT_EQ((*file)->problems().size(), 1u);
  EXPECT_EQ((*file)->problems()[0].severity, Problem::Severity::note);
}

TEST(Lights, DirectionIgnoresNodeScale) {
  for (const char* scale : {"[0, 0, 0]", "[1, 1, 0]"}) {
    GltfBuilder b;
    b.use_extension("KHR_lights_punctual");
    b.add_node_with_mesh(b.add_mesh(unit_quad()));
    b.set("/extensions/KHR_lights_punctual/lights", R"([{"type": "directional"}])");
    b.add_node(std::string(R"({"scale": )") + scale +
               R"(, "rotation": [-0.7071067811865476, 0, 0, 0.7071067811865476],
                   "extensions": {"KHR_lights_punctual": {"light": 0}}})");
    const auto scene = load_and_pose(b);
    ASSERT_TRUE(scene.ok()) << scene.status();
    ASSERT_EQ(scene->lights.size(), 1u) << scale;
    expect_point(Vec3d(scene->lights[0].direction), {0, -1, 0}, 1e-7);
  }
}

TEST(Volumes, IndexOneAbsorbersBecomeMedia) {
  GltfBuilder b;
  const char* const clear = R"({"pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {
      "KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1},
      "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2,
                               "attenuationColor": [1, 0.5, 0]}}})";
  for (const char* name :
       {"KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume"}) {
    b.use_extension(name);
  }
  b.add_node_with_mesh(b.add_mesh(unit_quad(b.add_material(clear))));
  const int tinted = b.add_mesh(unit_quad(b.add_material(clear)));
  b.add_node_with_mesh(tinted);
  b.set("/meshes/" + std::to_string(tinted) + "/primitives/0/attributes/COLOR_0",
        std::to_string(b.add_floats("VEC3", std::vector<float>(12, 0.5f))));
  const auto scene = load_and_pose(b);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_FALSE(scene->materials[0].has_volume);
  ASSERT_TRUE(scene->materials[0].medium);
  const Vec3f absorbed = scene->materials[0].medium->absorption;
  EXPECT_EQ(absorbed.x, 0);
  EXPECT_NEAR(absorbed.y, std::log(2.0) / 2, 1e-7);
  EXPECT_EQ(absorbed.z, std::numeric_limits<float>::infinity());
  EXPECT_TRUE(scene->materials[1].has_volume);
  EXPECT_FALSE(scene->materials[1].medium);
}

TEST(Precision, SmallDistantObjectWarns) {
  const auto warned_at = [](const char* x) {
    testing::MemoryReader reader;
    GltfBuilder b;
    b.add_mesh(unit_quad());
    b.add_node_with_mesh(0);
    b.add_node_with_mesh(0, std::string(R"({"translation": [)") + x + ", 0, 0]}");
    reader.put("scene.gltf", b.gltf());
    const auto file = load_scene_file("scene.gltf", {}, reader);
    EXPECT_TRUE((*file)->pose({}, 0).ok());
    const auto& problems = (*file)->problems();
    return std::any_of(problems.begin(), problems.end(), [](const Problem& p) {
      return p.severity == Problem::Severity::warning &&
             p.message.find("position error up to") != std::string::npos;
    });
  };
  EXPECT_FALSE(warned_at("1e5"));  // floats are 0.004 m apart at 5e4 m
  EXPECT_TRUE(warned_at("1e6"));   // 0.06 m
}

TEST(Environment, DarkLightsSuppressDefaultSky) {
  const auto lit_by = [](const char* light, const char* node, const char* material) {
    GltfBuilder b;
    b.use_extension("KHR_lights_punctual");
    b.use_extension("KHR_node_visibility");
    b.add_node_with_mesh(b.add_mesh(unit_quad()));
    b.set("/extensions/KHR_lights_punctual/lights", light);
    b.add_node_with_mesh(b.add_mesh(unit_quad(b.add_material(material))), node);
    const auto scene = load_and_pose(b);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene.ok() && scene->has_environment;
  };
  const char* const dark = R"([{"type": "point", "intensity": 0}])";
  const char* const holds_it = R"({"extensions": {"KHR_lights_punctual": {"light": 0}}})";
  const char* const hidden = R"({"extensions": {"KHR_node_visibility": {"visible": false}}})";
  const char* const lamp = R"({"emissiveFactor": [1, 1, 1]})";
  EXPECT_TRUE(lit_by(dark, "{}", "{}"));  // a light without a node
  EXPECT_FALSE(lit_by(dark, holds_it, "{}"));
  EXPECT_FALSE(lit_by(dark, hidden, lamp));
  EXPECT_TRUE(lit_by(dark, hidden, "{}"));
}

TEST(Environment, GlowingMediumSuppressesDefaultSky) {
  for (const char* const emission : {"[0, 0, 0]", "[0, 0, 2]"}) {
    const std::string medium = absl::StrCat(R"({"radius": 3, "emission": )", emission, "}");
    const std::string filled = R"({"emission": )" + std::string(emission) + "}";
    GltfBuilder everywhere, inside;
    for (GltfBuilder* b : {&everywhere, &inside}) {
      b->use_extension("TESSERA_medium");
      b->add_node_with_mesh(b->add_mesh(unit_quad(b->add_material("{}"))));
    }
    everywhere.set("/scenes/0/extensions/TESSERA_medium", medium);
    inside.set("/materials/0/extensions/TESSERA_medium", filled);
    const bool dark = std::string_view(emission) == "[0, 0, 0]";
    EXPECT_EQ(load_and_pose(everywhere)->has_environment, dark);
    EXPECT_EQ(load_and_pose(inside)->has_environment, dark);
  }
}

TEST(Environment, EmitterSuppressesDefaultSky) {
  GltfBuilder b;
  b.add_mesh(unit_quad(b.add_material(R"({"emissiveFactor": [1, 0, 0]})")));
  b.add_node_with_mesh(0);
  EXPECT_FALSE(load_and_pose(b)->has_environment);
  contract::RenderSettings settings;
  settings.background = contract::Background::color;
  settings.background_color = {0.5f, 0.25f, 0.125f};
  const auto scene = load_and_pose(b, settings);
  EXPECT_TRUE(scene->has_environment);
  EXPECT_EQ(scene->environment.constant, (Vec3f{0.5f, 0.25f, 0.125f}));
  EXPECT_EQ(scene->environment.strength, 1.0f);
}

TEST(Scenes, AreSelectedByIndexOrDefault) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node(R"({"mesh": 0})");
  b.add_node(R"({"mesh": 0})", false);
  b.add("scenes", R"({"nodes": [1]})");
  contract::RenderSettings settings;
  EXPECT_EQ(load_and_pose(b, settings)->instances[0].node, 0);
  settings.scene = 1;
  EXPECT_EQ(load_and_pose(b, settings)->instances[0].node, 1);
  settings.scene = 2;
  EXPECT_EQ(load_and_pose(b, settings).status().code(), absl::StatusCode::kInvalidArgument);
}

/// A quad below two moved nodes; scene 0 lists `nodes`.
absl::StatusOr<Scene> pose_listed(const std::string& nodes, const std::string& top = "{}") {
  GltfBuilder b;
  b.use_extension("KHR_node_visibility");
  b.add_node_with_mesh(b.add_mesh(unit_quad()), R"({"translation": [4, 0, 0]})");
  b.add_node(R"({"children": [0], "translation": [0, 2, 0]})");
  b.add_node(R"({"children": [1], "translation": [0, 0, 1], "extensions": )" + top + "}");
  b.set("/scenes/0/nodes", nodes);
  return load_and_pose(b);
}

TEST(Scenes, ListedInnerNodeIsRenderedInPlace) {
  const auto whole = pose_listed("[2]");
  ASSERT_TRUE(whole.ok()) << whole.status();
  for (const char* nodes : {"[0]", "[1]", "[0, 2]", "[2, 0]", "[1, 0, 1]", "[2, 2]"}) {
    const auto scene = pose_listed(nodes);
    ASSERT_TRUE(scene.ok()) << nodes << ": " << scene.status();
    ASSERT_EQ(scene->instances.size(), 1u) << nodes;
    EXPECT_EQ(scene->center, whole->center) << nodes;
  }
}

TEST(Scenes, InvisibleAncestorHidesListedNode) {
  const auto scene = pose_listed("[0]", R"({"KHR_node_visibility": {"visible": false}})");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_TRUE(scene->instances.empty());
}

/// A quad, and one part of each section that nothing uses and that has a fault.
std::unique_ptr<GltfBuilder> with_unused_faults() {
  auto b = std::make_unique<GltfBuilder>();
  b->use_extension("KHR_lights_punctual");
  b->add_node_with_mesh(b->add_mesh(unit_quad(b->add_material("{}"))));
  b->add("bufferViews", R"({"buffer": 0, "byteOffset": 100000, "byteLength": 4})");
  b->add("accessors", R"({"componentType": 1, "count": 0, "type": "VEC9"})");
  b->add("meshes", R"({"primitives": [{"attributes": {"POSITION": 99}}]})");
  b->add("skins", R"({"joints": []})");
  b->add("materials", R"({"alphaMode": "GLASS"})");
  b->add("materials", R"({"extensions": {"KHR_materials_ior": {"ior": 0.5}}})");
  b->add("images", R"({"bufferView": 77})");
  b->add("textures", R"({"source": 99})");
  b->add("cameras", R"({"type": "fisheye"})");
  b->add("animations", R"({"samplers": [], "channels": []})");
  b->add("animations", R"({"samplers": [{"input": 0, "output": 0}],
      "channels": [{"sampler": 5, "target": {"node": 0, "path": "scale"}}]})");
  b->set("/extensions/KHR_lights_punctual/lights", R"([{"type": "sun"}])");
  return b;
}

TEST(UnusedParts, FaultsAreWarnings) {
  MemoryReader reader;
  reader.put("scene.gltf", with_unused_faults()->gltf());
  const auto loaded = load_scene_file("scene.gltf", {}, reader);
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  const auto scene = (*loaded)->pose({}, 0);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->instances.size(), 1u);
  for (const char* part :
       {"bufferViews[", "accessors[", "meshes[1]", "skins[0]", "materials[1]", "materials[2]",
        "images[0]", "textures[0]", "cameras[0]", "animations[1]", "lights[0]"}) {
    const auto& all = (*loaded)->problems();
    EXPECT_TRUE(std::any_of(all.begin(), all.end(), [&](const Problem& p) {
      return p.severity == Problem::Severity::warning && p.element.find(part) != std::string::npos;
    })) << part;
  }
}

TEST(UnusedParts, FaultsAreErrorsOnceUsed) {
  struct Use {
    const char *pointer, *value, *part;
  };
  for (const Use& use :
       {Use{"/nodes/0/mesh", "1", "meshes[1]"}, Use{"/nodes/0/skin", "0", "skins[0]"},
        Use{"/nodes/0/camera", "0", "cameras[0]"},
        Use{"/nodes/0/extensions/KHR_lights_punctual/light", "0", "lights[0]"},
        Use{"/meshes/0/primitives/0/material", "1", "materials[1]"},
        Use{"/materials/0/emissiveTexture/index", "0", "textures[0]"}}) {
    const auto b = with_unused_faults();
    b->set(use.pointer, use.value);
    const std::string message(load_and_pose(*b).status().message());
    EXPECT_NE(message.find(use.part), std::string::npos) << use.part << ": " << message;
  }
}

TEST(Containers, GltfAndGlbGiveSameScene) {
  GltfBuilder b;
  b.add_mesh(unit_quad());
  b.add_node_with_mesh(0);
  const auto text = load_and_pose(b.gltf()), binary = load_and_pose(b.glb());
  ASSERT_TRUE(text.ok() && binary.ok()) << text.status() << binary.status();
  EXPECT_EQ(text->meshes[0].primitives[0].positions, binary->meshes[0].primitives[0].positions);
  EXPECT_EQ(text->meshes[0].primitives[0].triangles, binary->meshes[0].primitives[0].triangles);
}

}  // namespace
}  // namespace tessera::render
