// Hard cases 74 and 75: what the models TextureSettingsTest, TextureEncodingTest and
// TextureTransformMultiTest of Khronos show, as numbers; and textures at the poles of a sphere.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/numeric/gltf/material_probe.h"
#include "tests/support/scene/plain_scene.h"

namespace tessera::testing {
namespace {

using render::Vec2f;
using render::Vec3f;

constexpr int kRepeat = 10497, kMirror = 33648, kClamp = 33071, kNearest = 9728, kLinear = 9729;

/// The texel that a coordinate outside of [0, count) stands for. Source: OpenGL 4.6, table 8.20.
int wrapped(int i, int count, int mode) {
  if (mode == kClamp) return std::min(std::max(i, 0), count - 1);
  const int period = mode == kMirror ? 2 * count : count;
  const int inside = ((i % period) + period) % period;
  return inside < count ? inside : period - 1 - inside;
}

/// An image of 3 x 5 texels, of no power of two, with distinct codes.
constexpr int kColumns = 3, kRows = 5;
int code_at(int column, int row) {
  return 20 + 15 * (row * kColumns + column);
}

struct Sampling {
  int wrap_s, wrap_t, filter;
};

/// The value at (u, v), in double.
double expected_at(double u, double v, const Sampling& sampling) {
  const auto texel = [&](int i, int j) {
    return linear(
        code_at(wrapped(i, kColumns, sampling.wrap_s), wrapped(j, kRows, sampling.wrap_t)));
  };
  if (sampling.filter == kNearest) {
    return texel(static_cast<int>(std::floor(u * kColumns)),
                 static_cast<int>(std::floor(v * kRows)));
  }
  const double x = u * kColumns - 0.5, y = v * kRows - 0.5;
  const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
  const double a = x - i, b = y - j;
  return (texel(i, j) * (1 - a) + texel(i + 1, j) * a) * (1 - b) +
         (texel(i, j + 1) * (1 - a) + texel(i + 1, j + 1) * a) * b;
}

/// The emission of a square whose texture coordinates are (u, v) everywhere.
double read_at(float u, float v, const Sampling& sampling) {
  const auto file = probe_of(kX, kY);
  std::vector<std::uint8_t> codes;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      codes.insert(codes.end(), {static_cast<std::uint8_t>(code_at(column, row)), 0, 0, 255});
    }
  }
  file->add_texture(file->add_image(png(kColumns, kRows, codes), "image/png"),
                    R"({"wrapS": )" + std::to_string(sampling.wrap_s) + R"(, "wrapT": )" +
                        std::to_string(sampling.wrap_t) + R"(, "magFilter": )" +
                        std::to_string(sampling.filter) + "}");
  TriangleMesh square = unit_quad(
      file->add_material(R"({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}})"));
  square.uv.assign(4, Vec2f{u, v});
  file->add_node_with_mesh(file->add_mesh(square));
  contract::RenderSettings settings = probe_settings();
  settings.spp = 4;
  return seen(*file, settings).x;
}

TEST(GltfTextureSettings, AxesWrapIndependently) {  // hard case 75
  constexpr int kModes[] = {kRepeat, kMirror, kClamp};
  for (const int s : kModes) {
    for (const int t : kModes) {
      for (const int filter : {kNearest, kLinear}) {
        const Sampling sampling{s, t, filter};
        for (int i = 0; i < 12; ++i) {
          // From -2 to 2, on no edge of a texel.
          const float u = -2 + 0.3517f * static_cast<float>(i);
          const float v = 1.93f - 0.3291f * static_cast<float>((i * 5) % 12);
          ASSERT_NEAR(read_at(u, v, sampling), expected_at(u, v, sampling), 2e-6)
              << s << " " << t << " " << filter << " at " << u << " " << v;
        }
      }
    }
  }
}

/// A colour as a property `name` of a material, with an alpha of 1 if it has one.
std::string factor(const std::string& name, const Vec3d& rgb, bool has_alpha = true) {
  return "\"" + name + "\": [" + std::to_string(rgb.x) + ", " + std::to_string(rgb.y) + ", " +
         std::to_string(rgb.z) + (has_alpha ? ", 1]" : "]");
}

/// A texture reference with a transform, as in the file and as `texel` applies it.
struct Moved {
  double offset_u, offset_v, rotation, scale_u, scale_v;

  std::string json() const {
    return R"({"index": 0, "extensions": {"KHR_texture_transform": {"offset": [)" +
           std::to_string(offset_u) + ", " + std::to_string(offset_v) + R"(], "rotation": )" +
           std::to_string(rotation) + R"(, "scale": [)" + std::to_string(scale_u) + ", " +
           std::to_string(scale_v) + "]}}}";
  }
  /// Index of the texel of an image of 4 x 4 at (u, v). Source: KHR_texture_transform.
  int texel(double u, double v) const {
    const double x = u * scale_u, y = v * scale_v;
    const double c = std::cos(rotation), s = std::sin(rotation);
    const auto cell = [](double t) {
      return static_cast<int>(std::floor((t - std::floor(t)) * 4));
    };
    return cell(-s * x + c * y + offset_v) * 4 + cell(c * x + s * y + offset_u);
  }
};

TEST(GltfTextureTransform, SlotsMoveIndependently) {  // hard case 75
  const Moved base{0.5, 0.25, 0, 1, 1}, rough{0.1, 0.3, 1, 3, 2}, glow{0.7, 0.1, -2, 5, 7},
      bump{0.3, 0.9, 0.5, 2, 9};
  const double u = 0.37, v = 0.61;
  // Red, green and blue of each texel differ; only the texel that the normal map reads is flat.
  std::vector<std::uint8_t> codes(std::size_t{4} * 16), normals(std::size_t{4} * 16);
  for (int i = 0; i < 16; ++i) {
    const auto at = static_cast<std::size_t>(4 * i);
    const bool flat = i == bump.texel(u, v);
    for (std::size_t c = 0; c < 4; ++c) {
      codes[at + c] =
          c == 3 ? 255 : static_cast<std::uint8_t>(130 + 7 * i - 10 * static_cast<int>(c));
      normals[at + c] = c >= 2 || !flat ? 255 : 128;
    }
  }
  const auto code = [&](const Moved& m, std::size_t channel) {
    return static_cast<int>(codes[static_cast<std::size_t>(4 * m.texel(u, v)) + channel]);
  };
  std::string normal_reference = bump.json();
  normal_reference.replace(normal_reference.find("\"index\": 0"), 10, "\"index\": 1");
  // Lit by the sun or glowing: both together would be two lights, chosen at random.
  const auto radiance = [&](bool glows) {
    const auto file = probe_of(kX, kY);
    file->use_extension("KHR_texture_transform");
    if (!glows) add_sun(*file, 1);
    const std::string nearest = R"({"magFilter": 9728})";
    file->add_texture(file->add_image(png(4, 4, codes), ""), nearest);
    file->add_texture(file->add_image(png(4, 4, normals), ""), nearest);
    TriangleMesh square = unit_quad(file->add_material(
        R"({"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorTexture": )" + base.json() +
        R"(, "metallicRoughnessTexture": )" + rough.json() + R"(}, "emissiveFactor": )" +
        (glows ? "[1, 1, 1]" : "[0, 0, 0]") + R"(, "emissiveTexture": )" + glow.json() +
        R"(, "normalTexture": )" + normal_reference + "}"));
    square.uv.assign(4, Vec2f{static_cast<float>(u), static_cast<float>(v)});
    square.normals.assign(4, Vec3f{0, 0, 1});
    file->add_node_with_mesh(file->add_mesh(square));
    const int tangents = file->add_vec4(std::vector<render::Vec4f>(4, {1, 0, 0, 1}));
    file->set("/meshes/0/primitives/0/attributes/TANGENT", std::to_string(tangents));
    return seen(*file, probe_settings());
  };
  const Vec3d reflected = radiance(false), emitted = radiance(true);
  // The same numbers as factors; roughness is linear, in green.
  const auto colour = [&](const Moved& m, std::size_t c) { return linear(code(m, c)); };
  const Vec3d want = lit(
      with("", "", factor("baseColorFactor", {colour(base, 0), colour(base, 1), colour(base, 2)}),
           code(rough, 1) / 255.0));
  for (int c = 0; c < 3; ++c) {
    // Code 128 is not quite flat: the normal is tilted by 5.5e-3.
    EXPECT_NEAR(reflected[c], want[c], 2e-3 * want[c]) << c;
    EXPECT_NEAR(emitted[c], colour(glow, static_cast<std::size_t>(c)), 1e-6) << c;
  }
}

TEST(GltfTextureEncoding, OnlyColoursAreSrgb) {  // hard case 75
  // Each texture looks like a factor of the value that its code stands for.
  constexpr int kCode = 100;
  const std::vector<std::uint8_t> texel = {kCode, kCode, kCode, kCode};
  const Vec3d decoded{linear(kCode), linear(kCode), linear(kCode)};
  const double plain = kCode / 255.0;
  const std::string texture = R"({"index": 0})", number = std::to_string(plain);
  constexpr double kDigits =
      2e-5;  // of the six decimals in the file, and of a few dozen operations
  // Base colour and emission are sRGB.
  expect_near(lit(with("", "", R"("baseColorTexture": )" + texture), texel),
              lit(with("", "", factor("baseColorFactor", decoded))), kDigits);
  const Vec3d glow = lit(R"({"emissiveFactor": [1, 1, 1], "emissiveTexture": )" + texture +
                             R"(, "pbrMetallicRoughness":
                                  {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0},
                                "extensions": {"KHR_materials_specular": {"specularFactor": 0}}})",
                         texel);
  expect_near(glow, decoded, kDigits);
  // Roughness is linear, in green.
  const std::string white = R"("baseColorFactor": [1, 1, 1, 1])";
  expect_near(lit(with("", "", white + R"(, "metallicRoughnessTexture": )" + texture, 1), texel),
              lit(with("", "", white, plain)), kDigits);
  // Alpha is linear: 0.39 is above the cutoff, the 0.13 of an sRGB code would not be.
  const Vec3d masked = lit(R"({"alphaMode": "MASK", "alphaCutoff": 0.3,
                              "extensions": {"KHR_materials_unlit": {}},
                              "pbrMetallicRoughness": {"baseColorTexture": )" +
                               texture + "}}",
                           texel);
  expect_near(masked, decoded, kDigits);
  // The colours of extensions are sRGB, their factors linear.
  const auto specular = [&](const std::string& content) {
    return lit(with("KHR_materials_specular", "{" + content + "}"), texel);
  };
  expect_near(specular(R"("specularColorTexture": )" + texture),
              specular(factor("specularColorFactor", decoded, false)), kDigits);
  expect_near(specular(R"("specularTexture": )" + texture),
              specular(R"("specularFactor": )" + number), kDigits);
}

TEST(Texture, CheckerAtPoleOfSphereKeepsItsMean) {  // hard case 74
  constexpr int kSide = 1024;
  render::Image image;
  image.width = image.height = kSide;
  image.channels = 1;
  image.storage = render::Image::Storage::f32;
  std::vector<float> texels(std::size_t{kSide} * kSide);
  for (std::size_t i = 0; i < texels.size(); ++i) {
    texels[i] = (i / kSide + i % kSide) % 2 == 0 ? 1.0f : 0.0f;
  }
  image.f32 = texels;
  for (const bool nearest : {false, true}) {
    for (const double pole : {1.0, -1.0}) {
      render::Scene scene = empty_scene();
      scene.images.push_back(image);
      scene.textures.push_back({0, render::Wrap::repeat, render::Wrap::repeat, nearest});
      render::Material checker;
      checker.unlit = true;
      checker.base_color_texture.texture = 0;
      add_primitive(&scene, sphere({0, 0, 0}, 1, 64, add_material(&scene, checker)));
      look_at(&scene, {0, 3 * pole, 0}, {0, 0, 0});
      scene.camera.yfov = 0.3;  // the cap of 0.3 rad about the pole
      const Picture picture = render_picture(scene, small_settings(24, 24, 64));
      EXPECT_NEAR(picture.mean(), 0.5, 0.02) << nearest << pole;
      EXPECT_TRUE(picture.blocks[0].dropped.empty());
      for (const double value : picture.rgb) ASSERT_TRUE(value >= 0 && value <= 1);
      // The pixels about the pole itself, where all columns of the texture meet.
      double middle = 0;
      for (std::int32_t i = 0; i < 16; ++i) middle += picture.at(10 + i / 4, 10 + i % 4).x / 16;
      EXPECT_NEAR(middle, 0.5, 0.05) << nearest << pole;
    }
  }
}

}  // namespace
}  // namespace tessera::testing
