/// Reading of TESSERA extensions: accepted values, and error messages.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "tests/support/json_schema.h"
#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/scene/features.h"

namespace tessera::testing {
namespace {

using nlohmann::json;
using render::Camera;
using render::Scene;
using render::Vec3d;

const std::string perspective = R"("type": "perspective", "perspective": {"yfov": 1, "znear": 1})";
const std::string orthographic =
    R"("type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 9})";

/// A file with one camera of a kind with an extension; node 1 is at (0, 0, -3).
std::unique_ptr<GltfBuilder> filmed(const std::string& kind, const std::string& extension) {
  auto file = std::make_unique<GltfBuilder>();
  file->use_extension("TESSERA_camera");
  file->add("cameras", "{" + kind + R"(, "extensions": {"TESSERA_camera": )" + extension + "}}");
  file->add_node(R"({"camera": 0})");
  file->add_node(R"({"translation": [0, 0, -3]})");
  file->add_node_with_mesh(file->add_mesh(unit_quad()));
  return file;
}

std::string refusal(const GltfBuilder& file) {
  return std::string(load_and_pose(file).status().message());
}

struct Refused {
  std::string kind, extension, fault;
  bool by_schema = false;  // too
};

TEST(TesseraCamera, RejectsInvalidProperties) {
  const std::string at = "cameras[0].extensions.TESSERA_camera";
  for (const Refused& c : {
           Refused{perspective, R"({"lense": {}})",
                   ".lense: unknown property; expected one of projection", true},
           {perspective, R"({"projection": "flat"})", ".projection: is not spherical", true},
           {perspective, R"({"angle": 1})", ".angle: not allowed without a projection"},
           {perspective, R"({"projection": "spherical", "angle": 1})", ".angle: allowed only with"},
           {perspective, R"({"projection": "equisolid", "verticalAngle": 1})",
            ".verticalAngle: allowed only with"},
           {perspective, R"({"projection": "spherical", "horizontalAngle": 7})",
            ".horizontalAngle: 7 is not in", true},
           {perspective, R"({"projection": "cylindrical", "verticalAngle": 3.12})",
            ".verticalAngle: 3.12 is not in", true},
           {perspective, R"({"projection": "spherical", "verticalAngle": 3.15})",
            ".verticalAngle: 3.15 is not in", true},
           {perspective, R"({"projection": "equidistant", "angle": 0})", ".angle: must be above 0",
            true},
           {perspective,
            R"({"projection": "spherical", "lens": {"fNumber": 2, "focusDistance": 1}})",
            ".lens: not allowed with a curved projection"},
           {perspective, R"({"frustum": {"left": -1, "right": 1, "bottom": -1, "top": 1}})",
            ".frustum: has no near", true},
           {perspective,
            R"({"frustum": {"left": 1, "right": 1, "bottom": -1, "top": 1, "near": 1}})",
            ".frustum: left is not below right"},
           {perspective,
            R"({"frustum": {"left": -1, "right": 1, "bottom": -1, "top": 1, "near": 0}})",
            ".frustum.near: 0 is not in"},
           {perspective,
            R"({"frustum": {"left": -1, "right": 1, "bottom": -1, "top": 1, "near": 2, "far": 1}})",
            ".frustum: near is not below far"},
           {perspective, R"({"direction": [0, 0, -1]})",
            ".direction: not allowed on a perspective camera"},
           {orthographic, R"({"direction": [1, 0, 0]})", ".direction: must point forwards"},
           {orthographic, R"({"direction": [1, 0]})", ".direction: must be an array of 3", true},
           {orthographic, R"({"lens": {"fNumber": 2, "focusDistance": 1}})",
            ".lens: needs a perspective camera"},
           {perspective, R"({"lookAt": {"position": [0, 0, 0]}})", ".lookAt: has no target", true},
           {perspective, R"({"lookAt": {"position": [0, 0, 0], "target": [0, 2, 0]}})",
            ".lookAt: position, target and up do not define a direction"},
           {perspective, R"({"lens": {"focusDistance": 1}})", ".lens: has no fNumber", true},
           {perspective, R"({"lens": {"fNumber": 0, "focusDistance": 1}})",
            ".lens.fNumber: 0 is not in", true},
           {perspective, R"({"lens": {"fNumber": 2}})",
            ".lens: must have either focusDistance or focusNode"},
           {perspective, R"({"lens": {"fNumber": 2, "focusDistance": 1, "focusNode": 1}})",
            ".lens: must have either focusDistance or focusNode"},
           {perspective, R"({"lens": {"fNumber": 2, "focusNode": 9}})",
            ".lens.focusNode: 9 is not the index"},
           {perspective, R"({"lens": {"fNumber": 2, "focusNode": 0}})",
            ".lens.focusNode: nodes[0] is not in front of the camera"},
           {perspective, R"({"lens": {"fNumber": 2, "focusDistance": 1, "blades": 2}})",
            ".lens.blades: must be 0 or 3 to 64"},
           {perspective, R"({"lens": {"fNumber": 2, "focusDistance": 1, "rim": {"radius": 1}}})",
            ".lens.rim: has no distance", true},
           {perspective, R"({"shutter": {"open": 0}})", ".shutter: has no close", true},
           {perspective, R"({"shutter": {"open": 1, "close": 0.5}})",
            ".shutter: open is after close"},
       }) {
    contract::RenderSettings settings;
    settings.camera = "0";  // the framing camera does not replace a selected one
    const auto file = filmed(c.kind, c.extension);
    const std::string message(load_and_pose(*file, settings).status().message());
    EXPECT_NE(message.find(at + c.fault), std::string::npos) << c.extension << "\n" << message;
    const json schema = support::read_schema("TESSERA_camera");
    EXPECT_EQ(!support::schema_faults(schema, json::parse(c.extension)).empty(), c.by_schema)
        << c.extension;
  }
}

TEST(TesseraCamera, LargestVerticalAnglesAreAccepted) {
  const json schema = support::read_schema("TESSERA_camera");
  for (const char* extension : {R"({"projection": "cylindrical", "verticalAngle": 3.1})",
                                R"({"projection": "spherical", "verticalAngle": 3.12})"}) {
    EXPECT_EQ(refusal(*filmed(perspective, extension)), "");
    EXPECT_TRUE(support::schema_faults(schema, json::parse(extension)).empty()) << extension;
  }
}

TEST(TesseraExtensions, MisplacedOrUnlistedAreRejected) {
  const auto file = filmed(perspective, "{}");
  EXPECT_EQ(refusal(*file), "");
  file->set("/nodes/0/extensions/TESSERA_camera", "{}");
  EXPECT_EQ(refusal(*file),
            "scene.gltf: nodes[0].extensions.TESSERA_camera: not allowed here, only on elements "
            "of cameras");
  const auto misspelled = filmed(perspective, "{}");
  misspelled->set("/cameras/0/extensions/TESSERA_camra", "{}");
  EXPECT_EQ(refusal(*misspelled),
            "scene.gltf: cameras[0].extensions.TESSERA_camra: unknown TESSERA extension "
            "(misspelled or newer?)");
  GltfBuilder unlisted;
  unlisted.add("cameras", "{" + perspective + R"(, "extensions": {"TESSERA_camera": {}}})");
  EXPECT_EQ(refusal(unlisted),
            "scene.gltf: cameras[0].extensions.TESSERA_camera: is not listed in extensionsUsed");
  const auto extras = filmed(perspective, "{}");
  extras->set("/nodes/0/extras/extensions/TESSERA_anything", "{}");
  EXPECT_EQ(refusal(*extras), "");
}

Camera camera_of(const GltfBuilder& file) {
  const auto scene = load_and_pose(file);
  EXPECT_TRUE(scene.ok()) << scene.status();
  return scene.ok() ? scene->camera : Camera();
}

TEST(LaxParts, UsedButInvalidPartsGiveWarnings) {
  GltfBuilder b;
  b.add_mesh(unit_quad(b.add_material(
      R"({"emissiveFactor": [50, 0, 0], "extensions": {"KHR_materials_unlit": {}}})")));
  b.add_node_with_mesh(
      0, R"({"matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], "translation": [1, 0, 0]})");
  MemoryReader reader;
  reader.put("scene.gltf", b.gltf());
  const auto file = render::load_scene_file("scene.gltf", {}, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  std::set<std::string> warned;
  for (const render::Problem& problem : (*file)->problems()) warned.insert(problem.element);
  const std::set<std::string> expected = {"materials[0].emissiveFactor", "materials[0].extensions",
                                          "nodes[0]"};
  EXPECT_EQ(warned, expected);
}

TEST(TesseraCamera, PropertiesAreRead) {
  const Camera window = camera_of(*filmed(
      perspective,
      R"({"frustum": {"left": -1, "right": 3, "bottom": -2, "top": 1, "near": 2, "far": 8}})"));
  EXPECT_DOUBLE_EQ(window.center_x, 0.5);
  EXPECT_DOUBLE_EQ(window.center_y, -0.25);
  EXPECT_NEAR(window.yfov, 2 * std::atan(0.75), 1e-15);
  EXPECT_EQ(window.znear, 2);
  EXPECT_EQ(window.zfar, 8);
  const Camera flat = camera_of(
      *filmed(orthographic,
              R"({"frustum": {"left": -1, "right": 3, "bottom": -2, "top": 1, "near": 2, "far": 8},
          "direction": [1, -2, -4]})"));
  EXPECT_EQ(flat.center_x, 1);
  EXPECT_EQ(flat.ymag, 1.5);
  EXPECT_EQ(flat.slant_x, 0.25);
  EXPECT_EQ(flat.slant_y, -0.5);
  const Camera round = camera_of(*filmed(perspective, R"({"projection": "equisolid"})"));
  EXPECT_EQ(round.kind, Camera::Kind::equisolid);
  EXPECT_EQ(round.vertical_angle, 3.14159265358979323846);
}

TEST(TesseraCamera, FocalLengthFollowsSensorAndFov) {
  const Camera lens = camera_of(
      *filmed(perspective, R"({"lens": {"fNumber": 2, "sensorHeight": 0.5, "focusNode": 1}})"));
  EXPECT_NEAR(lens.lens.radius, 0.25 / std::tan(0.5) / 2 / 2, 1e-15);
  EXPECT_DOUBLE_EQ(lens.lens.focus_distance, 3);
}

TEST(TesseraCamera, LooksAtTargetInNodeSpace) {
  const auto file = filmed(perspective,
                           R"({"lookAt": {"position": [1, 2, 3], "target": [1, 2, 7],
                                          "up": [1, 0, 0]}})");
  file->set("/nodes/0/translation", "[10, 0, 0]");
  file->set("/nodes/0/scale", "[2, 2, 2]");
  const auto scene = load_and_pose(*file);
  ASSERT_TRUE(scene.ok());
  const auto& m = scene->camera.camera_to_world;
  const auto column = [&](int k) { return Vec3d{m.rows[0][k], m.rows[1][k], m.rows[2][k]}; };
  EXPECT_EQ(m.translation + scene->center, (Vec3d{12, 4, 6}));
  EXPECT_EQ(column(2), (Vec3d{0, 0, -1}));  // backwards
  EXPECT_EQ(column(1), (Vec3d{1, 0, 0}));
  EXPECT_EQ(column(0), (Vec3d{0, 1, 0}));
}

/// A quad whose base colour is procedural.
std::unique_ptr<GltfBuilder> textured(const std::string& extension) {
  auto file = std::make_unique<GltfBuilder>();
  file->use_extension("TESSERA_texture");
  file->add("textures", R"({"extensions": {"TESSERA_texture": )" + extension + "}}");
  const int material =
      file->add_material(R"({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})");
  file->add_node_with_mesh(file->add_mesh(unit_quad(material)));
  return file;
}

TEST(TesseraTexture, RejectsInvalidProperties) {
  const std::string at = "textures[0].extensions.TESSERA_texture";
  for (const Refused& c : {
           Refused{"", R"({})", ".pattern: must be one of noise, valueNoise", true},
           {"", R"({"pattern": "plaid"})", ".pattern: must be one of noise, valueNoise", true},
           {"", R"({"pattern": "fbm", "octave": 3})",
            ".octave: unknown property; expected one of pattern", true},
           {"", R"({"pattern": "fbm", "space": "screen"})", ".space: is not object", true},
           {"", R"({"pattern": "fbm", "dimensions": 0})", ".dimensions: must be 1 to 4", true},
           {"", R"({"pattern": "fbm", "dimensions": 5})", ".dimensions: 5 is not an integer", true},
           {"", R"({"pattern": "fbm", "scale": 3})", ".scale: must be an array of 3", true},
           {"", R"({"pattern": "fbm", "scale": [1e20, 1, 1]})", ".scale: is too large"},
           {"", R"({"pattern": "fbm", "octaves": 25})", ".octaves: 25 is not an integer", true},
           {"", R"({"pattern": "fbm", "octaves": 0})", ".octaves: must be 1 to 24", true},
           {"", R"({"pattern": "fbm", "gain": 2})", ".gain: 2 is not in [0, 1]", true},
           {"", R"({"pattern": "fbm", "lacunarity": 0.5})", ".lacunarity: 0.5 is not in", true},
           {"", R"({"pattern": "fbm", "seed": -1})", ".seed: -1 is not an integer", true},
           {"", R"({"pattern": "fbm", "ramp": []})", ".ramp: is empty", true},
           {"", R"({"pattern": "fbm", "ramp": [{"at": 0}]})", ".ramp[0]: has no color", true},
           {"", R"({"pattern": "fbm", "ramp": [{"color": [0, 0, 0, 2]}]})",
            ".ramp[0].color: is negative or too large"},
           {"",
            R"({"pattern": "fbm", "ramp": [{"at": 0.5, "color": [0, 0, 0, 1]},
                                           {"at": 0.5, "color": [1, 1, 1, 1]}]})",
            ".ramp[1].at: must be above that of the previous stop"},
       }) {
    const std::string message = refusal(*textured(c.extension));
    EXPECT_NE(message.find(at + c.fault), std::string::npos) << c.extension << "\n" << message;
    const json schema = support::read_schema("TESSERA_texture");
    EXPECT_EQ(!support::schema_faults(schema, json::parse(c.extension)).empty(), c.by_schema)
        << c.extension;
  }
}

TEST(TesseraTexture, OverridesImage) {
  const auto scene = load_and_pose(*textured(
      R"({"pattern": "ridged", "space": "uv", "dimensions": 2, "scale": [1, 2, 3], "seed": 9,
          "ramp": [{"at": 0.5, "color": [1, 2, 3, 0.25]}]})"));
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->procedural_textures.size(), 1u);
  const render::ProceduralTexture& f = scene->procedural_textures[0];
  EXPECT_EQ(f.pattern, render::ProceduralTexture::Pattern::ridged);
  EXPECT_EQ(f.space, render::ProceduralTexture::Space::uv);
  EXPECT_EQ(f.dimensions, 2);
  EXPECT_EQ(f.scale, (render::Vec3f{1, 2, 3}));
  EXPECT_EQ(f.seed, 9u);
  EXPECT_EQ(f.ramp[0].color.w, 0.25f);
  const render::TextureRef& ref = scene->materials[0].base_color_texture;
  ASSERT_TRUE(ref);
  EXPECT_EQ(scene->textures[static_cast<std::size_t>(ref.texture)].procedural, 0);
}

/// A quad in a scene with fog; texture 0 is procedural, texture 1 is not, accessor ACCESSOR has 8
/// densities.
std::unique_ptr<GltfBuilder> foggy(const std::string& extension, bool on_material = false) {
  auto file = textured(R"({"pattern": "fbm"})");
  file->use_extension("TESSERA_medium");
  file->add("textures", "{}");
  const int grid = file->add_floats("SCALAR", {0, 1, 2, 3, 4, 5, 6, 7});
  std::string text = extension;
  if (const auto at = text.find("ACCESSOR"); at != std::string::npos) {
    text.replace(at, 8, std::to_string(grid));
  }
  file->set(on_material ? "/materials/0/extensions/TESSERA_medium"
                        : "/scenes/0/extensions/TESSERA_medium",
            text);
  return file;
}

TEST(TesseraMedium, OnlyEmissionNeedsEmissiveMedia) {
  for (const bool on_material : {false, true}) {
    const auto clear = load_and_pose(*foggy(R"({"scattering": [1, 1, 1]})", on_material));
    ASSERT_TRUE(clear.ok()) << clear.status();
    EXPECT_EQ(
        features_of(*clear).features & (render::kFeatureMedia | render::kFeatureEmissiveMedia),
        render::kFeatureMedia);
    const auto glowing =
        load_and_pose(*foggy(R"({"absorption": [1, 1, 1], "emission": [0, 0, 1]})", on_material));
    ASSERT_TRUE(glowing.ok()) << glowing.status();
    EXPECT_NE(features_of(*glowing).features & render::kFeatureEmissiveMedia, 0u);
    EXPECT_EQ(render::feature_names(features_of(*glowing).features).back(), "emissive-media");
  }
}

TEST(TesseraMedium, RejectsInvalidProperties) {
  const std::string grid = R"({"density": {"grid": {"accessor": ACCESSOR, "size": [2, 2, 2], )";
  const std::string at = "scenes[0].extensions.TESSERA_medium";
  for (const Refused& c : {
           Refused{"", R"({"absorb": [1, 1, 1]})",
                   ".absorb: unknown property; expected one of absorption", true},
           {"", R"({"absorption": 1})", ".absorption: must be an array of 3", true},
           {"", R"({"scattering": [1, -1, 1]})", ".scattering: is not in [0, 1e+09]", true},
           {"", R"({"emission": [1, 1, -1]})", ".emission: is not in [0, 1e+09]", true},
           {"", R"({"emission": [0, 1, 0], "absorption": [1, 0, 1]})",
            ".emission: without absorption needs a radius"},
           {"", R"({"anisotropy": 1})", ".anisotropy: 1 is not in [-0.999, 0.999]", true},
           {"", R"({"radius": -1})", ".radius: -1 is not in", true},
           {"", R"({"center": [1e30, 0, 0]})", ": center is too far from the origin"},
           {"", R"({"density": {}})", ".density: must have a texture or a grid"},
           {"", R"({"density": {"texture": 0, "grid": {}}})", ".density: must have a texture or a",
            true},
           {"", R"({"density": {"texture": 7}})", ".density.texture: 7 is not the index of one of"},
           {"", R"({"density": {"texture": 1}})", ".density.texture: names a texture without"},
           {"", R"({"density": {"grid": {"size": [2, 2, 1]}}})", ".size: must be whole numbers",
            true},
           {"", R"({"density": {"grid": {"size": [2, 2, 2.5]}}})", ".size: must be whole numbers",
            true},
           {"", grid + R"("min": [0, 0, 0]}}})", ".density.grid: has no max"},
           {"", grid + R"("min": [0, 0, 0], "max": [1, 0, 1]}}})", ".grid.max: is not above min"},
           {"",
            R"({"density": {"grid": {"size": [2, 2, 3], "accessor": ACCESSOR,
                "min": [0, 0, 0], "max": [1, 1, 1]}}})",
            ".accessor: must have 12 values to match size"},
       }) {
    const std::string message = refusal(*foggy(c.extension));
    EXPECT_NE(message.find(at), std::string::npos) << message;
    EXPECT_NE(message.find(c.fault), std::string::npos) << c.extension << "\n" << message;
    if (c.extension.find("ACCESSOR") != std::string::npos) continue;
    const json schema = support::read_schema("TESSERA_medium");
    EXPECT_EQ(!support::schema_faults(schema, json::parse(c.extension)).empty(), c.by_schema)
        << c.extension;
  }
  EXPECT_NE(refusal(*foggy(R"({"radius": 3})", true)).find("radius: unknown property"),
            std::string::npos);
}

TEST(TesseraMedium, IsReadFromScenesAndMaterials) {
  const auto scene = load_and_pose(*foggy(R"({"absorption": [1, 2, 3], "scattering": [4, 5, 6],
      "emission": [7, 8, 9], "anisotropy": 0.5, "center": [1, 2, 3], "radius": 7, "density": {"texture": 0}})"));
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_TRUE(scene->atmosphere.has_value());
  EXPECT_EQ(scene->atmosphere->medium.absorption, (render::Vec3f{1, 2, 3}));
  EXPECT_EQ(scene->atmosphere->medium.scattering, (render::Vec3f{4, 5, 6}));
  EXPECT_EQ(scene->atmosphere->medium.emission, (render::Vec3f{7, 8, 9}));
  EXPECT_EQ(scene->atmosphere->medium.anisotropy, 0.5f);
  EXPECT_EQ(scene->atmosphere->center + scene->center, (Vec3d{1, 2, 3}));
  EXPECT_EQ(scene->atmosphere->radius, 7);
  EXPECT_EQ(scene->atmosphere->medium.procedural, 0);
  const auto filled = load_and_pose(*foggy(R"({"density": {"grid": {"accessor": ACCESSOR,
      "size": [2, 2, 2], "min": [0, 0, 0], "max": [1, 2, 3]}}})",
                                           true));
  ASSERT_TRUE(filled.ok()) << filled.status();
  EXPECT_FALSE(filled->atmosphere.has_value());
  ASSERT_TRUE(filled->materials[0].medium.has_value());
  ASSERT_NE(filled->materials[0].medium->grid, nullptr);
  EXPECT_EQ(filled->materials[0].medium->grid->high, (render::Vec3f{1, 2, 3}));
  EXPECT_EQ(filled->materials[0].medium->grid->values[5], 5);
}

/// Checks every TESSERA extension in `value` against its schema; returns their number.
int check_schemas(const json& value, const std::string& file) {
  if (!value.is_structured()) return 0;
  int count = 0;
  for (const auto& item : value.items()) {
    if (item.key().starts_with("TESSERA_")) {
      const auto faults = support::schema_faults(support::read_schema(item.key()), item.value());
      EXPECT_TRUE(faults.empty()) << file << " " << item.key() << " " << faults.front();
      ++count;
    }
    count += check_schemas(item.value(), file);
  }
  return count;
}

TEST(TesseraExtensions, ExampleScenesMatchSchemas) {
  const auto folder = std::filesystem::path(TESSERA_SOURCE_DIR) / "tests/scenes";
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".gltf") continue;
    std::ifstream file(entry.path());
    count += check_schemas(json::parse(file), entry.path().filename().string());
  }
  EXPECT_GT(count, 20) << "the example scenes use the extensions";
}

TEST(TesseraExtensions, ExtrasAreIgnoredInEveryObject) {
  struct Accepted {
    std::string name, extension;
    std::unique_ptr<GltfBuilder> file;
  };
  const std::string camera =
      R"({"extras": {"note": "any"}, "extensions": {}, "shutter": {"close": 0.5, "extras": 1},
          "lens": {"fNumber": 2, "focusDistance": 1, "extras": [1, 2]}})";
  const std::string texture =
      R"({"pattern": "fbm", "extras": 1, "ramp": [{"color": [0, 0, 0, 1], "extras": "any"}]})";
  const std::string medium =
      R"({"extras": null, "extensions": {}, "density": {"texture": 0, "extras": {}}})";
  Accepted cases[] = {{"TESSERA_camera", camera, filmed(perspective, camera)},
                      {"TESSERA_texture", texture, textured(texture)},
                      {"TESSERA_medium", medium, foggy(medium)}};
  for (const Accepted& c : cases) {
    EXPECT_EQ(refusal(*c.file), "") << c.name;
    const auto faults =
        support::schema_faults(support::read_schema(c.name), json::parse(c.extension));
    EXPECT_TRUE(faults.empty()) << c.name << " " << faults.front();
  }
}

/// Checks that every object in a schema may have the properties that any glTF object may have.
int check_common_properties(const json& schema, const std::string& name) {
  if (!schema.is_structured()) return 0;
  int count = 0;
  if (schema.contains("additionalProperties")) {
    ++count;
    EXPECT_TRUE(schema["properties"].contains("extras")) << name << " " << schema.dump();
    EXPECT_TRUE(schema["properties"].contains("extensions")) << name << " " << schema.dump();
  }
  for (const json& member : schema) count += check_common_properties(member, name);
  return count;
}

TEST(TesseraExtensions, SchemasAllowExtrasInEveryObject) {
  int count = 0;
  for (const char* name :
       {"blobs", "camera", "csg", "material", "medium", "shape", "terrain", "texture"}) {
    const std::string extension = std::string("TESSERA_") + name;
    count += check_common_properties(support::read_schema(extension), extension);
  }
  EXPECT_GE(count, 19) << "objects in the schemas";
}

}  // namespace
}  // namespace tessera::testing
