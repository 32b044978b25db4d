#include "worker/shading/surface/surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/support/scene/plain_scene.h"
#include "worker/light/light_sampler.h"

namespace tessera::testing {
namespace {

using render::Material;
using render::Primitive;
using render::Scene;
using render::ShadingScene;
using render::TriangleId;
using render::Vec2f;
using render::Vec3d;
using render::Vec3f;
using render::Vec4f;
using render::Wrap;

/// Adds an image of 8-bit RGBA codes and a texture that uses it; returns the texture.
std::int32_t add_texture(Scene* scene, std::int32_t width, std::int32_t height,
                         std::vector<std::uint8_t> codes, Wrap wrap = Wrap::repeat) {
  render::Image image;
  image.width = width;
  image.height = height;
  image.channels = 4;
  image.u8 = std::move(codes);
  scene->images.push_back(std::move(image));
  scene->textures.push_back(
      {static_cast<std::int32_t>(scene->images.size()) - 1, wrap, wrap, false});
  return static_cast<std::int32_t>(scene->textures.size()) - 1;
}

/// Radiance at the centre of a unit square that fills the view: (0.5, 0.5) of uv set 0.
Vec3d seen(Scene scene, Primitive square) {
  add_primitive(&scene, std::move(square));
  scene.camera.yfov = 1e-5;
  return render_picture(std::move(scene), small_settings(1, 1, 4)).at(0, 0);
}

Primitive unit_square(std::int32_t material) {
  // Off the centre of the view, where rays would hit the diagonal.
  Primitive p = quad({-0.5f, -0.5f, 0}, {1, 0, 0}, {0, 1, 0}, material);
  p.triangles = {{0, 1, 3}, {1, 2, 3}};
  return p;
}

Material unlit_with(std::int32_t texture, bool srgb) {
  Material m;
  m.unlit = true;
  m.base_color_texture.texture = texture;
  m.base_color_texture.srgb = srgb;
  return m;
}

TEST(Surface, TextureUsesUvSetAndTransform) {
  Scene scene = empty_scene();
  // Two by two: red 51, 102 above 153, 204.
  const auto t = add_texture(
      &scene, 2, 2, {51, 0, 0, 255, 102, 0, 0, 255, 153, 0, 0, 255, 204, 0, 0, 255}, Wrap::clamp);
  Material m = unlit_with(t, false);
  const auto index = add_material(&scene, m);
  Primitive square = unit_square(index);
  EXPECT_NEAR(seen(scene, square).x, 127.5 / 255, 1e-5);  // the four's mean
  square.uv[1].assign(4, Vec2f{0.75f, 0.25f});
  scene.materials[static_cast<std::size_t>(index)].base_color_texture.uv_set = 1;
  EXPECT_NEAR(seen(scene, square).x, 102.0 / 255, 1e-6);
  auto& ref = scene.materials[static_cast<std::size_t>(index)].base_color_texture;
  ref.has_transform = true;
  ref.uv_matrix = {0, 1, 0, 1, 0, 0};  // swaps u and v
  EXPECT_NEAR(seen(scene, square).x, 153.0 / 255, 1e-6);
  ref.srgb = true;
  EXPECT_NEAR(seen(scene, square).x, 0.318547, 1e-6);  // code 153
}

TEST(Surface, VertexColourScalesTexture) {
  Scene scene = empty_scene();
  const auto t = add_texture(&scene, 1, 1, {255, 255, 255, 255});
  Material m = unlit_with(t, false);
  m.base_color = {0.5f, 1, 1, 1};
  Primitive square = unit_square(add_material(&scene, m));
  square.colors = {{1, 0, 0, 1}, {0, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 0, 1}};
  const Vec3d c = seen(scene, square);
  EXPECT_NEAR(c.x, 0, 1e-4);  // on the line between the dark corners
  square.colors.assign(4, Vec4f{0.25f, 0.5f, 1, 1});
  EXPECT_EQ(seen(scene, square), (Vec3d{0.125, 0.5, 1}));
}

/// Renders a square of `m` under a constant environment of radiance 1. `scene` has the textures.
Picture render_square(Scene scene, const Material& m, const Vec4f& tangent) {
  Primitive square = quad({-9, -9, 0}, {18, 0, 0}, {0, 18, 0}, add_material(&scene, m));
  square.tangents.assign(4, tangent);
  square.normals.assign(4, Vec3f{0, 0, 1});
  add_primitive(&scene, square);
  set_constant_sky(&scene, 1);
  look_at(&scene, {3, 1, 2}, {0, 0, 0});
  Picture picture = render_picture(scene, small_settings(6, 6, 64));
  EXPECT_TRUE(picture.blocks[0].dropped.empty());
  return picture;
}

TEST(Surface, DegenerateNormalMapsGainNoEnergy) {  // hard case 50
  const std::uint8_t texels[][4] = {
      {128, 128, 0, 255},    // straight down
      {128, 128, 128, 255},  // almost no length
      {255, 128, 128, 255},  // along the surface
      {0, 0, 20, 255},       // below the horizon
  };
  for (const auto& texel : texels) {
    for (const bool bad_tangent : {false, true}) {
      for (const float roughness : {0.0f, 0.4f}) {
        Scene scene = empty_scene();
        Material m = metal(roughness);
        m.normal_texture.texture =
            add_texture(&scene, 1, 1, {texel[0], texel[1], texel[2], texel[3]});
        const Vec4f tangent = bad_tangent ? Vec4f{0, 0, 1, 1} : Vec4f{1, 0, 0, -1};
        const Picture picture = render_square(scene, m, tangent);
        EXPECT_LE(picture.mean(), 1 + 1e-6 + 4 * std::sqrt(3) * picture.mean_error());
        EXPECT_GT(picture.mean(), 0.2);
      }
    }
  }
}

/// A square of `m` with a normal map of one float texel, whose decoded normal is 2 texel - 1.
double mean_of_mapped_square(Material m, const Vec3f& texel, const Vec4f& tangent) {
  Scene scene = empty_scene();
  render::Image image;
  image.width = image.height = 1;
  image.channels = 3;
  image.storage = render::Image::Storage::f32;
  image.f32 = {texel.x, texel.y, texel.z};
  scene.images.push_back(std::move(image));
  scene.textures.push_back({0, render::Wrap::repeat, render::Wrap::repeat, false});
  m.normal_texture.texture = static_cast<std::int32_t>(scene.textures.size()) - 1;
  const Picture picture = render_square(scene, m, tangent);
  EXPECT_LE(picture.mean(), 1.001 + 4 * picture.mean_error());
  return picture.mean();
}

TEST(Surface, ExactlyDegenerateNormalsGainNoEnergy) {  // hard case 50
  const Vec3f texels[] = {{0.5f, 0.5f, 0},             // straight down
                          {0.5f, 0.5f, 0.5f},          // of length 0
                          {1, 0.5f, 0.5f}};            // along the tangent
  for (const Vec3f& texel : texels) {
    for (const Vec4f& tangent : {Vec4f{1, 0, 0, 1}, Vec4f{1, 0, 0, -1}, Vec4f{0, 0, 1, 1}}) {
      for (const float roughness : {0.0f, 0.4f}) {
        Material plastic = lambert({1, 1, 1});
        plastic.specular = 1;
        plastic.roughness = roughness;
        EXPECT_GT(mean_of_mapped_square(metal(roughness), texel, tangent), 0.2);
        EXPECT_GT(mean_of_mapped_square(plastic, texel, tangent), 0.2);
      }
    }
  }
}

TEST(Surface, NormalMapTiltsShadingNormal) {
  Scene scene = empty_scene();
  Material m;
  m.normal_texture.texture =
      add_texture(&scene, 1, 1, {255, 128, 128, 255});  // towards the tangent
  m.normal_scale = 1;
  Primitive square = unit_square(add_material(&scene, m));
  square.tangents.assign(4, Vec4f{0, 1, 0, 1});
  add_primitive(&scene, square);
  const ShadingScene shading(scene);
  const auto p = render::surface_at(shading, {0, 0, 0}, 0.3f, 0.3f, {0, 0, -1});
  const Vec3f n = render::shading_normal_at(shading, p);
  EXPECT_GT(n.y, 0.99f);
  EXPECT_NEAR(n.x, 0, 0.01f);
}

TEST(Surface, NormalsUseInverseTranspose) {  // hard case 26
  Scene scene = empty_scene();
  add_primitive(&scene, sphere({0, 0, 0}, 1, 32, 0), scaling(1, 1, 0.01));
  const ShadingScene shading(scene);
  const auto& p = scene.meshes[0].primitives[0];
  for (std::uint32_t t = 0; t < p.triangles.size(); t += 7) {
    const auto point = render::surface_at(shading, {0, 0, t}, 0, 0, {0, 0, -1});
    const Vec3d n(p.normals[p.triangles[t][0]]);
    const Vec3d expected = normalize(Vec3d{n.x, n.y, n.z * 100});
    const Vec3f got = render::shading_normal_at(shading, point);
    ASSERT_LE(length(Vec3d(got) - expected), 1e-6) << t;
  }
}

TEST(Emitters, DegenerateTrianglesAreNeverSampled) {  // hard case 57
  Scene scene = empty_scene();
  Material m = lambert({0, 0, 0});
  m.emission = {1, 1, 1};
  const auto index = add_material(&scene, m);
  Primitive p = quad({-1, 2, -1}, {2, 0, 0}, {0, 0, 2}, index);  // faces down
  p.triangles.push_back({0, 0, 1});
  p.triangles.push_back({2, 2, 2});
  add_primitive(&scene, p);
  const auto white = add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, quad({-9, 0, 9}, {18, 0, 0}, {0, 0, -18}, white));
  const ShadingScene shading(scene);
  const render::LightSampler lights(scene, shading);
  const render::LightSampleContext floor{{0, 0, 0}, {0, 1, 0}, false};
  EXPECT_GT(lights.emitter_pdf(floor, {0, 0, 0}, 1, 1), 0);
  EXPECT_LT(lights.emitter_pdf(floor, {0, 0, 0}, 1, 0), std::numeric_limits<float>::infinity());
  const render::LightSampleContext far{{0, -90, 0}, {0, 1, 0}, false};  // sampled by area there
  EXPECT_EQ(lights.emitter_pdf(far, {0, 0, 0}, 1, 0), std::numeric_limits<float>::infinity());
  EXPECT_EQ(lights.emitter_pdf(floor, {0, 0, 2}, 1, 1), 0);
  EXPECT_EQ(lights.emitter_pdf(floor, {0, 0, 3}, 1, 0), 0);
  for (int i = 0; i < 1000; ++i) {
    render::LightSample s;
    if (!lights.sample(floor, {i / 1000.0, 0.3, 0.6}, &s)) continue;
    ASSERT_LT(s.triangle.triangle, 2u);
  }
}

TEST(Emitters, DensityIsPositiveWhereLightIsEmitted) {  // hard case 66
  Scene scene = empty_scene();
  // A texture with one texel that is not black: most triangles never emit.
  std::vector<std::uint8_t> codes(32 * 32 * 4, 0);
  codes[(13 * 32 + 9) * 4] = 200;
  Material m = lambert({0, 0, 0});
  m.emission = {1, 1, 1};
  m.emissive_texture.texture = add_texture(&scene, 32, 32, codes);
  m.emissive_texture.srgb = true;
  m.emissive_texture.has_transform = true;
  m.emissive_texture.uv_matrix = {3.3f, 0.4f, -0.7f, -0.2f, 2.1f, 0.9f};
  add_primitive(&scene, sphere({0, 0, 0}, 1, 64, add_material(&scene, m)));
  const ShadingScene shading(scene);
  const render::LightSampler lights(scene, shading);
  int lit = 0, dark = 0;
  const auto count = static_cast<std::uint32_t>(scene.meshes[0].primitives[0].triangles.size());
  for (std::uint32_t t = 0; t < count; ++t) {
    const TriangleId id{0, 0, t};
    const float density = lights.emitter_pdf({{0, 0, 3}, {0, 0, 1}, false}, id, 1, 1);
    dark += density == 0 ? 1 : 0;
    for (int k = 0; k < 60; ++k) {
      const float b1 = static_cast<float>(k % 10) / 10, b2 = (1 - b1) * static_cast<float>(k) / 60;
      auto point = render::surface_at(shading, id, b1, b2, {0, 0, -1});
      point.front = true;
      if (!(render::max_component(render::emission_at(shading, point, {0, 0, 1})) > 0)) continue;
      ++lit;
      ASSERT_GT(density, 0) << t;
    }
  }
  EXPECT_GT(lit, 100);
  EXPECT_GT(dark, static_cast<int>(count) / 4);
}

}  // namespace
}  // namespace tessera::testing
