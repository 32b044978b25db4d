// Hard cases 5 and 27: translated and mirrored scenes, as in the models NegativeScaleTest and
// NormalTangentMirrorTest of Khronos.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "tests/numeric/gltf/material_probe.h"
#include "tests/support/scene/memory_scene.h"
#include "tests/support/scene/plain_scene.h"

namespace tessera::testing {
namespace {

using render::Vec2f;
using render::Vec3f;
using render::Vec4f;

std::string json(const Vec3d& v) {
  return "[" + std::to_string(v.x) + ", " + std::to_string(v.y) + ", " + std::to_string(v.z) + "]";
}

Picture picture_of(const GltfBuilder& file, const contract::RenderSettings& settings) {
  auto scene = load_and_pose(file, settings);
  EXPECT_TRUE(scene.ok()) << scene.status();
  return scene.ok() ? render_picture(*std::move(scene), settings) : Picture();
}

/// The Cornell box in a file whose root node has `placement`: three walls, floor and ceiling, two
/// turned blocks, a lamp and the camera. Its numbers are exact in binary: the products and sums of
/// transforms round nowhere for translations below 2^20 that are multiples of 2^-16.
std::unique_ptr<GltfBuilder> cornell_box(const std::string& placement) {
  auto file = std::make_unique<GltfBuilder>();
  const auto colour = [&](const std::string& rgb) {
    return file->add_material(R"({"pbrMetallicRoughness": {"metallicFactor": 0,
        "baseColorFactor": [)" +
                              rgb + R"(, 1]}})");
  };
  const int white = colour("0.75, 0.75, 0.75"), red = colour("0.5, 0.0625, 0.0625"),
            green = colour("0.125, 0.5, 0.125");
  const int light = file->add_material(R"({"emissiveFactor": [1, 1, 0.75],
      "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8}}})");
  file->use_extension("KHR_materials_emissive_strength");
  std::string children;
  file->add_node("{" + placement + "}");  // node 0, whose children follow
  const auto add_child = [&](const std::string& node) {
    children += (children.empty() ? "" : ", ") + std::to_string(file->add_node(node, false));
  };
  // Placed by the columns of a matrix.
  const auto add = [&](int mesh, const std::string& matrix) {
    add_child(R"({"mesh": )" + std::to_string(mesh) + R"(, "matrix": [)" + matrix + "]}");
  };
  const auto square = [&](int material) { return file->add_mesh(unit_quad(material)); };
  add(square(white), "2,0,0,0, 0,0,-2,0, 0,1,0,0, -1,0,1,1");   // floor
  add(square(white), "2,0,0,0, 0,0,2,0, 0,-1,0,0, -1,2,-1,1");  // ceiling
  add(square(white), "2,0,0,0, 0,2,0,0, 0,0,1,0, -1,0,-1,1");   // back
  add(square(red), "0,0,-2,0, 0,2,0,0, 1,0,0,0, -1,0,1,1");     // left
  add(square(green), "0,0,2,0, 0,2,0,0, -1,0,0,0, 1,0,-1,1");   // right
  add(square(light), "0.5,0,0,0, 0,0,0.5,0, 0,-1,0,0, -0.25,1.96875,-0.25,1");
  const int block = file->add_mesh(box_around_unit_square(white));
  add(block, "0.1875,0,-0.0625,0, 0,0.25,0,0, 0.0625,0,0.25,0, -0.5,0.25,-0.375,1");
  add(block, "0.1875,0,0.0625,0, 0,0.375,0,0, -0.0625,0,0.1875,0, 0.25,0.375,0.25,1");
  file->add("cameras", R"({"type": "perspective", "perspective":
      {"yfov": 0.75, "znear": 0.125, "zfar": 64}})");
  add_child(R"({"camera": 0, "translation": [0, 1, 4]})");
  file->set("/nodes/0/children", "[" + children + "]");
  return file;
}

std::string bytes_of_blocks(const Picture& picture) {
  std::string all;
  for (const auto& block : picture.blocks) all += contract::encode(block);
  return all;
}

TEST(Recentring, TranslatedCornellBoxHasSameBits) {  // hard case 5
  auto settings = small_settings(32, 32, 16);
  const Picture here = picture_of(*cornell_box(R"("translation": [0, 0, 0])"), settings);
  EXPECT_GT(here.mean(), 0.05);
  for (const Vec3d& to : {Vec3d{1e6, 1e6, 1e6}, Vec3d{-524288.5, 3, 1e6 + 0.0625}}) {
    const Picture there = picture_of(*cornell_box(R"("translation": )" + json(to)), settings);
    EXPECT_TRUE(bytes_of_blocks(there) == bytes_of_blocks(here)) << json(to);
  }
}

TEST(Recentring, InexactTranslationKeepsExpectation) {  // hard case 5
  auto settings = small_settings(32, 32, 256);
  // Turned, so that the transforms round as well.
  const std::string turned = R"("rotation": [0.2, 0.3, 0.1, 0.9273618495495704])";
  const Picture here = picture_of(*cornell_box(turned), settings);
  settings.seed = 1;
  for (const double by : {1e6, 1e7}) {
    const Vec3d to{by + 0.1, -by / 3, by / 7};
    const Picture there =
        picture_of(*cornell_box(turned + R"(, "translation": )" + json(to)), settings);
    EXPECT_GT(there.mean(), 0.05);
    EXPECT_LT(largest_difference(here, there), 4.5) << by;
  }
}

/// A closed, asymmetric body with a different colour on every side: a tetrahedron whose texture has
/// one texel a face.
int add_body(GltfBuilder& file, bool glows) {
  const std::vector<Vec3f> corners = {
      {-0.6f, -0.5f, 0.3f}, {0.7f, -0.4f, 0.4f}, {-0.1f, -0.3f, -0.6f}, {0.2f, 0.8f, 0.1f}};
  TriangleMesh body;
  const std::vector<std::vector<std::size_t>> faces = {{0, 1, 3}, {1, 2, 3}, {2, 0, 3}, {0, 2, 1}};
  for (std::size_t f = 0; f < 4; ++f) {
    for (const std::size_t corner : faces[f]) {
      body.positions.push_back(corners[corner]);
      body.uv.push_back({(static_cast<float>(f) + 0.5f) / 4, 0.5f});
    }
  }
  file.add_texture(file.add_image(png(4, 1,
                                      {255, 80, 80, 255, 80, 255, 80, 255, 80, 80, 255, 255,  //
                                       255, 255, 80, 255}),
                                  ""));
  body.material = file.add_material(
      glows
          ? R"({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}})"
          : R"({"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorTexture": {"index": 0}}})");
  return file.add_mesh(body);
}

/// The body under `scale` (of its node, in the node of a parent if `nested`), with a lamp at
/// (1, 2, 4) times the signs of x and y, so that the light is mirrored as well.
Picture body_under(const Vec3d& scale, bool nested, bool glows, bool cull) {
  const auto file = std::make_unique<GltfBuilder>();
  file->add("cameras", R"({"type": "perspective", "perspective": {"yfov": 0.6, "znear": 0.1}})");
  file->add_node(R"({"camera": 0, "translation": [0, 0, 5]})");
  file->use_extension("KHR_lights_punctual");
  file->set("/extensions/KHR_lights_punctual/lights", R"([{"type": "point", "intensity": 60}])");
  file->add_node(R"({"translation": )" + json({scale.x, 2 * scale.y, 4}) +
                 R"(, "extensions": {"KHR_lights_punctual": {"light": 0}}})");
  const int body = add_body(*file, glows);
  const std::string mesh = R"("mesh": )" + std::to_string(body);
  if (nested) {
    // Two mirrors in a row, about x and about x, y or z: their product is that of `scale`.
    const int inner = file->add_node(R"({)" + mesh + R"(, "scale": [-1, 1, 1]})", false);
    file->add_node(R"({"children": [)" + std::to_string(inner) + R"(], "scale": )" +
                   json({-scale.x, scale.y, scale.z}) + "}");
  } else {
    file->add_node(R"({)" + mesh + R"(, "scale": )" + json(scale) + "}");
  }
  contract::RenderSettings settings = small_settings(32, 32, 64);
  settings.max_depth = 2;
  settings.cull_backfaces = cull;
  return picture_of(*file, settings);
}

/// The picture that is seen in a mirror.
Picture mirrored(Picture picture, bool about_x, bool about_y) {
  const Picture from = picture;
  for (std::int32_t y = 0; y < from.height; ++y) {
    for (std::int32_t x = 0; x < from.width; ++x) {
      const std::int32_t source_x = about_x ? from.width - 1 - x : x;
      const std::int32_t source_y = about_y ? from.height - 1 - y : y;
      for (std::int32_t c = 0; c < 3; ++c) {
        const auto to = static_cast<std::size_t>(3 * (y * from.width + x) + c);
        const auto at = static_cast<std::size_t>(3 * (source_y * from.width + source_x) + c);
        picture.rgb[to] = from.rgb[at];
        picture.error[to] = from.error[at];
      }
    }
  }
  return picture;
}

TEST(GltfNegativeScale, BodiesLookLikeTheirMirrorImages) {  // hard case 27
  for (const bool glows : {false, true}) {
    const Picture plain = body_under({1, 1, 1}, false, glows, true);
    EXPECT_GT(plain.mean(), 0.02);
    for (const Vec3d& scale : {Vec3d{-1, 1, 1}, Vec3d{1, -1, 1}, Vec3d{-1, -1, 1}}) {
      for (const bool nested : {false, true}) {
        // Faces with the wrong winding would be culled, and would not emit.
        const Picture there = body_under(scale, nested, glows, true);
        EXPECT_LT(largest_difference(mirrored(plain, scale.x < 0, scale.y < 0), there), 4.5)
            << json(scale) << nested << glows;
      }
    }
    // About z another side is seen: that of the body mirrored about x and turned half about y.
    EXPECT_GT(body_under({1, 1, -1}, false, glows, true).mean(), 0.01);
  }
}

TEST(GltfNegativeScale, CullingKeepsClosedBodies) {  // hard case 27
  for (const Vec3d& scale :
       {Vec3d{1, 1, 1}, Vec3d{-1, 1, 1}, Vec3d{1, 1, -1}, Vec3d{-1, -1, -1}, Vec3d{-1, 1, -1}}) {
    const Picture all = body_under(scale, false, true, false);
    const Picture culled = body_under(scale, false, true, true);
    EXPECT_EQ(all.rgb, culled.rgb) << json(scale);
    EXPECT_GT(all.mean(), 0.05) << json(scale);
  }
}

/// Cosine of the shading normal of a white square under a sun of pi lux along -z turned by 15
/// degrees towards -x; its normal map has one texel.
double cosine_of(const std::vector<std::uint8_t>& texel, bool mirrored_uv, bool given_tangents,
                 const Vec3d& scale) {
  const auto file = probe_of(scale.x * kX, scale.y * kY);
  add_sun(*file, std::numbers::pi);
  file->set("/nodes/1/rotation", "[0, 0.1305261922, 0, 0.9914448614]");
  file->add_texture(file->add_image(png(1, 1, texel), ""));
  TriangleMesh square = unit_quad(file->add_material(
      R"({"pbrMetallicRoughness": {"metallicFactor": 0}, "normalTexture": {"index": 0},
          "extensions": {"KHR_materials_specular": {"specularFactor": 0}}})"));
  square.normals.assign(4, {0, 0, 1});
  for (Vec2f& uv : square.uv) uv = mirrored_uv ? Vec2f{1 - uv.x, 1 - uv.y} : Vec2f{uv.x, 1 - uv.y};
  file->add_node_with_mesh(file->add_mesh(square), R"({"scale": )" + json(scale) + "}");
  if (given_tangents) {
    const Vec4f tangent = mirrored_uv ? Vec4f{-1, 0, 0, -1} : Vec4f{1, 0, 0, 1};
    const int tangents = file->add_vec4(std::vector<Vec4f>(4, tangent));
    file->set("/meshes/0/primitives/0/attributes/TANGENT", std::to_string(tangents));
  }
  return seen(*file, probe_settings()).x;
}

TEST(GltfNormalTangent, MirroredUvAndScaleTiltConsistently) {  // hard case 27
  const std::vector<std::uint8_t> texel = {178, 102, 230, 255};
  const auto part = [&](std::size_t c) { return 2 * texel[c] / 255.0 - 1; };
  for (const bool mirrored_uv : {false, true}) {
    for (const bool given : {false, true}) {
      for (const Vec3d& scale : {Vec3d{1, 1, 1}, Vec3d{-1, 1, 1}, Vec3d{1, -1, 1}}) {
        // Red along growing u, green up in the image, which is y in both; then the mirror.
        const Vec3d in_object{mirrored_uv ? -part(0) : part(0), part(1), part(2)};
        const Vec3d n = normalize(Vec3d{in_object.x * scale.x, in_object.y * scale.y, in_object.z});
        const double want =
            n.x * std::sin(std::numbers::pi / 12) + n.z * std::cos(std::numbers::pi / 12);
        EXPECT_NEAR(cosine_of(texel, mirrored_uv, given, scale), want, 2e-6)
            << mirrored_uv << given << json(scale);
      }
    }
  }
}

}  // namespace
}  // namespace tessera::testing
