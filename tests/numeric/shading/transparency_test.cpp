#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "tests/support/scene/plain_scene.h"
#include "worker/render/pixel_sums.h"
#include "worker/scene/volumes.h"
#include "worker/shading/surface/surface.h"

namespace tessera::testing {
namespace {

using contract::Background;
using render::AlphaMode;
using render::Material;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

Material lamp(float radiance) {
  Material m = lambert({0, 0, 0});
  m.emission = {radiance, radiance, radiance};
  return m;
}

/// Adds a sheet facing the camera that fills the view at depth z.
void add_sheet(Scene* scene, float z, std::int32_t material) {
  add_primitive(scene, quad({-9, -9, z}, {18, 0, 0}, {0, 18, 0}, material));
}

Material thin_glass(const Vec3f& tint) {
  Material m = glass(1.5f);
  m.has_volume = false;
  m.base_color = {tint.x, tint.y, tint.z, 1};
  return m;
}

void expect_mean(const Scene& scene, const contract::RenderSettings& settings, double expected,
                 double largest_error) {
  const Picture picture = render_picture(scene, settings);
  // Grey light: the errors of the three channels are equal, not independent.
  const double error = std::sqrt(3) * picture.mean_error();
  EXPECT_NEAR(picture.mean(), expected, 4 * error + 1e-6);
  EXPECT_LT(error, largest_error);
}

TEST(Beer, TransmittanceIsPowerOfDistance) {  // hard case 43
  const float inf = std::numeric_limits<float>::infinity();
  const float sigma = std::log(2.0f);
  EXPECT_FLOAT_EQ(render::beer_transmittance({sigma, 0, inf}, 3).x, 0.125f);
  EXPECT_EQ(render::beer_transmittance({sigma, 0, inf}, 3), (Vec3f{0.125f, 1, 0}));
  EXPECT_EQ(render::beer_transmittance({sigma, 0, inf}, 0), (Vec3f{1, 1, 1}));
  EXPECT_FLOAT_EQ(render::beer_transmittance({1, 0, 0}, 100).x, 3.7835e-44f);
  EXPECT_EQ(render::beer_transmittance({1, 1, 1}, inf), (Vec3f{0, 0, 0}));
}

TEST(Beer, LimitsOfTheExtensionAreExact) {  // hard case 43
  const float inf = std::numeric_limits<float>::infinity();
  Material m = glass(1.5f);
  m.attenuation_color = {0.5f, 0, 1};
  m.attenuation_distance = inf;  // no absorption, however dark the colour
  EXPECT_EQ(render::beer_transmittance(render::volume_absorption(m), 3).x, 1);
  m.attenuation_distance = 1;
  const Vec3f t = render::beer_transmittance(render::volume_absorption(m), 1e-8f);
  EXPECT_FLOAT_EQ(t.x, 1);  // 1 - T is below the precision of T; nothing computes it
  EXPECT_EQ(t.y, 0);        // colour 0
  EXPECT_EQ(t.z, 1);
}

TEST(Beer, IndexMatchedSlabOnlyAbsorbs) {
  Scene scene = empty_scene();
  Material m = glass(1);
  m.attenuation_color = {0.8f, 0.8f, 0.8f};  // too bright for Russian roulette
  m.attenuation_distance = 1;
  add_primitive(&scene, box({-9, -9, -3}, {9, 9, 0}, false, add_material(&scene, m)));
  set_constant_sky(&scene, 1);
  scene.camera.yfov = 1e-4;
  EXPECT_NEAR(render_picture(scene, small_settings(1, 1, 4)).at(0, 0).x, 0.512, 1e-6);
  scene.materials[1].attenuation_color = {1, 0, 0.9f};
  const Vec3d c = render_picture(scene, small_settings(1, 1, 4)).at(0, 0);
  EXPECT_EQ(c.x, 1);
  EXPECT_EQ(c.y, 0);
  EXPECT_NEAR(c.z, 0.729, 1e-6);
}

/// A slab of glass of thickness 1 that fills the view, with a sheet of a radiance behind it.
Scene slab_scene(bool absorbing, float radiance_behind) {
  Scene scene = empty_scene();
  Material m = glass(1.5f);
  if (absorbing) {
    const float c = std::exp(-1.0f);
    m.attenuation_color = {c, c, c};
    m.attenuation_distance = 1;
  }
  add_primitive(&scene, box({-90, -90, -1}, {90, 90, 0}, false, add_material(&scene, m)));
  add_sheet(&scene, -3, add_material(&scene, lamp(radiance_behind)));
  scene.camera.yfov = 1e-3;
  return scene;
}

TEST(Glass, SlabSumsAllInternalReflections) {  // hard case 44
  auto settings = small_settings(32, 32, 320);
  settings.max_depth = 64;
  for (const bool absorbing : {false, true}) {
    expect_mean(slab_scene(absorbing, 1), settings, absorbing ? 0.339111 : 0.923077, 1e-3);
    Scene lit = slab_scene(absorbing, 0);  // from the front
    set_constant_sky(&lit, 1);
    expect_mean(lit, settings, absorbing ? 0.044990 : 0.076923, 1e-3);
    Scene even = slab_scene(absorbing, 1);
    set_constant_sky(&even, 1);
    expect_mean(even, settings, absorbing ? 1 - 0.615899 : 1, 1e-3);
  }
}

TEST(Glass, SlabReportsTruncatedEnergy) {  // hard case 44
  auto settings = small_settings(32, 32, 256);
  settings.max_depth = 2;
  const Picture picture = render_picture(slab_scene(false, 1), settings);
  double truncated = 0;
  for (const contract::FilmBlock& block : picture.blocks) truncated += block.truncated_energy;
  const double samples = 32.0 * 32 * 256, reported = truncated / (3 * samples);
  EXPECT_GT(reported, 0);
  // One path in 64 continues and counts 64 times.
  const double error = std::sqrt(3) * picture.mean_error() + std::sqrt(64 * reported / samples);
  EXPECT_NEAR(picture.mean() + reported, 0.923077, 4 * error);
}

TEST(Glass, SmoothSphereVanishesInFurnace) {  // hard case 46
  Scene scene = empty_scene();
  add_primitive(&scene, sphere({0, 0, 0}, 1, 48, add_material(&scene, glass(1.5f))));
  set_constant_sky(&scene, 1);
  auto settings = small_settings(16, 16, 64);
  settings.max_depth = 255;  // interpolated normals trap a few paths for a hundred reflections
  const Picture picture = render_picture(scene, settings);
  for (const double v : picture.rgb) ASSERT_NEAR(v, 1, 1e-4);
}

TEST(Glass, IndexOneSphereIsInvisible) {  // hard case 41
  Scene scene = empty_scene();
  std::vector<float> sky(64 * 32 * 3);
  for (std::size_t i = 0; i < sky.size(); ++i) sky[i] = static_cast<float>(i % 29);
  set_sky(&scene, 64, 32, sky);
  const Picture without = render_picture(scene, small_settings(12, 12, 16));
  add_primitive(&scene, sphere({0, 0, 0}, 1, 32, add_material(&scene, glass(1))));
  const Picture with = render_picture(scene, small_settings(12, 12, 16));
  for (std::size_t i = 0; i < with.rgb.size(); ++i) {
    ASSERT_NEAR(with.rgb[i], without.rgb[i], 1e-4 * (1 + without.rgb[i]));
  }
}

TEST(Furnace, WhiteDielectricSphereVanishes) {  // hard case 46
  for (const float roughness : {0.0f, 0.25f, 1.0f}) {
    Scene scene = empty_scene();
    Material m = lambert({1, 1, 1});
    m.specular = 1;
    m.roughness = roughness;
    add_primitive(&scene, sphere({0, 0, 0}, 1, 64, add_material(&scene, m)));
    set_constant_sky(&scene, 1);
    constexpr std::uint32_t kSeeds = 64;  // which give the standard error of each pixel
    std::vector<double> sums(16 * 16 * 3), squares(sums.size());  // of what exceeds the sky
    for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
      contract::RenderSettings settings = small_settings(16, 16, 16);
      settings.seed = seed;
      const Picture picture = render_picture(scene, settings);
      for (std::size_t i = 0; i < sums.size(); ++i) {
        sums[i] += picture.rgb.at(i) - 1;
        squares[i] += (picture.rgb[i] - 1) * (picture.rgb[i] - 1);
      }
    }
    for (std::size_t i = 0; i < sums.size(); ++i) {
      const double excess = sums[i] / kSeeds;
      const double variance = (squares[i] / kSeeds - excess * excess) / (kSeeds - 1);
      ASSERT_LE(excess, 1e-3 + 4 * std::sqrt(std::max(variance, 0.0))) << roughness << ", " << i;
    }
    scene.camera.yfov = 0.2;  // only the sphere
    EXPECT_NEAR(render_picture(scene, small_settings(8, 8, 256)).mean(), 1, 2e-3) << roughness;
  }
}

TEST(Furnace, RoughMetalAndGlassKeepEnergy) {  // hard cases 38, 46
  for (const bool is_metal : {true, false}) {
    for (const float roughness : {0.3f, 0.6f, 1.0f}) {
      Scene scene = empty_scene();
      Material m = is_metal ? metal(roughness) : glass(1.5f);
      m.roughness = roughness;
      add_primitive(&scene, sphere({0, 0, 0}, 1, 64, add_material(&scene, m)));
      set_constant_sky(&scene, 1);
      scene.camera.yfov = 0.2;  // only the sphere
      auto settings = small_settings(8, 8, 1024);
      settings.max_depth = 200;
      const Picture picture = render_picture(scene, settings);
      const double error = std::sqrt(3) * picture.mean_error();  // grey: its channels are one
      EXPECT_LT(error, is_metal ? 1e-3 : 5e-3);
      EXPECT_NEAR(picture.mean(), 1, (is_metal ? 5e-3 : 1e-2) + 4 * error)
          << (is_metal ? "metal " : "glass ") << roughness;
    }
  }
}

TEST(ThinSheet, TintsLightOnceWithoutBending) {
  Scene scene = empty_scene();
  add_sheet(&scene, 0, add_material(&scene, thin_glass({0.8f, 0.8f, 0.8f})));
  add_sheet(&scene, -1, add_material(&scene, lamp(1)));
  scene.camera.yfov = 1e-3;
  auto settings = small_settings(8, 8, 256);
  settings.max_depth = 1;
  expect_mean(scene, settings, 0.96 * 0.8, 4e-3);
}

TEST(ThinSheet, DoesNotCountAsDepth) {
  Scene scene = empty_scene();
  const auto clear = add_material(&scene, thin_glass({1, 1, 1}));
  for (int i = 0; i < 20; ++i) add_sheet(&scene, -0.1f * static_cast<float>(i), clear);
  add_sheet(&scene, -5, add_material(&scene, lamp(1)));
  scene.camera.yfov = 1e-3;
  auto settings = small_settings(16, 16, 64);
  settings.max_depth = 1;
  expect_mean(scene, settings, std::pow(0.96, 20), 8e-3);
}

TEST(ThinSheet, TintsShadowRaysExactly) {
  Scene scene = empty_scene();
  const auto floor = add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, quad({-9, 0, 9}, {18, 0, 0}, {0, 0, -18}, floor));
  const auto red = add_material(&scene, thin_glass({0.9f, 0.5f, 0.1f}));
  const auto green = add_material(&scene, thin_glass({0.3f, 1, 0.7f}));
  add_primitive(&scene, quad({-0.1f, 1, 0.1f}, {0.2f, 0, 0}, {0, 0, -0.2f}, red));
  add_primitive(&scene, quad({-0.1f, 1.5f, 0.1f}, {0.2f, 0, 0}, {0, 0, -0.2f}, green));
  render::PunctualLight light;
  light.intensity = {1, 1, 1};
  light.position = {0, 2, 0};
  scene.lights.push_back(light);
  look_at(&scene, {2, 1, 0}, {0, 0, 0});
  scene.camera.yfov = 1e-5;
  auto settings = small_settings(1, 1, 4);
  settings.max_depth = 1;
  const Vec3d c = render_picture(scene, settings).at(0, 0);
  const double open = 1 / std::numbers::pi / 4 * 0.96 * 0.96;
  EXPECT_NEAR(c.x, open * 0.27, 1e-6);
  EXPECT_NEAR(c.y, open * 0.5, 1e-6);
  EXPECT_NEAR(c.z, open * 0.07, 1e-6);
}

Material veil(float alpha) {
  Material m = lambert({0, 0, 0});
  m.base_color.w = alpha;
  m.alpha_mode = AlphaMode::blend;
  return m;
}

TEST(Alpha, StackedSheetsMultiply) {  // hard case 53
  Scene scene = empty_scene();
  const auto m = add_material(&scene, veil(0.1f));
  for (int i = 0; i < 64; ++i) add_sheet(&scene, -0.01f * static_cast<float>(i), m);
  add_sheet(&scene, -5, add_material(&scene, lamp(1)));
  const double expected = std::pow(0.9, 64);
  const Picture picture = render_picture(scene, small_settings(24, 24, 128));
  const double error = std::sqrt(expected / (24 * 24 * 128));  // of Bernoulli trials
  EXPECT_NEAR(picture.mean(), expected, 4 * error);
}

TEST(Alpha, ShadowRaysUseSameOpacity) {  // hard case 53
  Scene scene = empty_scene();
  const auto floor = add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, quad({-9, 0, 9}, {18, 0, 0}, {0, 0, -18}, floor));
  const auto m = add_material(&scene, veil(0.1f));
  for (int i = 0; i < 16; ++i) {
    add_primitive(&scene, quad({-0.1f, 1 + 0.01f * static_cast<float>(i), 0.1f}, {0.2f, 0, 0},
                               {0, 0, -0.2f}, m));
  }
  render::PunctualLight light;
  light.intensity = {1, 1, 1};
  light.position = {0, 2, 0};
  scene.lights.push_back(light);
  look_at(&scene, {2, 1, 0}, {0, 0, 0});
  scene.camera.yfov = 1e-4;
  auto settings = small_settings(8, 8, 128);
  settings.max_depth = 1;
  expect_mean(scene, settings, std::pow(0.9, 16) / std::numbers::pi / 4, 5e-4);
}

TEST(Alpha, MaskIsOpaqueAtCutoff) {  // hard case 53
  Scene scene = empty_scene();
  Material m = lamp(1);
  m.alpha_mode = AlphaMode::mask;
  m.base_color.w = m.alpha_cutoff = 0.3f;
  const auto index = static_cast<std::size_t>(add_material(&scene, m));
  add_sheet(&scene, 0, static_cast<std::int32_t>(index));
  EXPECT_EQ(render_picture(scene, small_settings(2, 2, 4)).alpha[0], 1);
  scene.materials[index].base_color.w = std::nextafter(0.3f, 0.0f);
  EXPECT_EQ(render_picture(scene, small_settings(2, 2, 4)).alpha[0], 0);
}

TEST(Alpha, TransparencyLimitIsCounted) {
  Scene scene = empty_scene();
  const auto m = add_material(&scene, veil(0));
  render::Primitive sheets;
  sheets.material = m;
  for (int i = 0; i < 1100; ++i) {
    const render::Primitive q =
        quad({-9, -9, -0.001f * static_cast<float>(i)}, {18, 0, 0}, {0, 18, 0}, m);
    const auto first = static_cast<std::uint32_t>(sheets.positions.size());
    sheets.positions.insert(sheets.positions.end(), q.positions.begin(), q.positions.end());
    for (const auto& t : q.triangles) {
      sheets.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
  }
  add_primitive(&scene, sheets);
  add_sheet(&scene, -5, add_material(&scene, lamp(1)));
  const Picture picture = render_picture(scene, small_settings(2, 2, 4));
  EXPECT_EQ(picture.mean(), 0);
  EXPECT_EQ(picture.blocks[0].transparency_limit_count, 16u);
}

struct Seen {
  Vec3d rgb;
  double alpha;
};

Seen seen(const Scene& scene, Background background, int spp = 4) {
  auto settings = small_settings(2, 2, spp);
  settings.background = background;
  settings.background_color = {0.25f, 0.5f, 0.75f};
  const Picture picture = render_picture(scene, settings);
  return {picture.at(1, 1), picture.alpha[3]};
}

TEST(Background, EmptyViewShowsChosenBackground) {
  Scene scene = empty_scene();
  EXPECT_EQ(seen(scene, Background::automatic).alpha, 0);  // without a sky: none
  set_constant_sky(&scene, 3);
  EXPECT_EQ(seen(scene, Background::automatic).rgb, (Vec3d{3, 3, 3}));
  EXPECT_EQ(seen(scene, Background::automatic).alpha, 1);
  EXPECT_EQ(seen(scene, Background::none).rgb, (Vec3d{0, 0, 0}));
  EXPECT_EQ(seen(scene, Background::none).alpha, 0);
  EXPECT_EQ(seen(scene, Background::color).rgb, (Vec3d{0.25, 0.5, 0.75}));
  EXPECT_EQ(seen(scene, Background::color).alpha, 1);
}

TEST(Background, ReflectionsShowSkyAndAreOpaque) {
  Scene scene = empty_scene();
  set_constant_sky(&scene, 3);
  add_sheet(&scene, 0, add_material(&scene, metal(0)));
  for (const Background b : {Background::automatic, Background::none, Background::color}) {
    EXPECT_NEAR(seen(scene, b).rgb.x, 3, 1e-5);
    EXPECT_EQ(seen(scene, b).alpha, 1);
  }
  scene.materials[1] = thin_glass({1, 1, 1});
  EXPECT_NEAR(seen(scene, Background::none).rgb.x, 3, 1e-5);
  EXPECT_EQ(seen(scene, Background::none).alpha, 1);
}

TEST(Background, HolesGivePremultipliedAlpha) {
  Scene scene = empty_scene();
  Material m;
  m.unlit = true;
  m.base_color = {0.8f, 0.8f, 0.8f, 0.5f};
  m.alpha_mode = AlphaMode::blend;
  add_sheet(&scene, 0, add_material(&scene, m));
  const Seen s = seen(scene, Background::none, 4096);
  EXPECT_NEAR(s.alpha, 0.5, 0.04);
  EXPECT_NEAR(s.rgb.x, 0.8 * s.alpha, 1e-6);
}

TEST(Unlit, IsVisibleToCameraOnly) {
  Scene scene = empty_scene();
  Material m;
  m.unlit = true;
  m.base_color = {0.2f, 0.4f, 0.6f, 1};
  const auto unlit = add_material(&scene, m);
  add_sheet(&scene, 0, unlit);
  EXPECT_NEAR(seen(scene, Background::automatic).rgb.y, 0.4, 1e-6);
  // It casts no shadow: the floor is lit through it.
  Scene floor = empty_scene();
  floor.materials.push_back(m);
  const auto white = add_material(&floor, lambert({1, 1, 1}));
  add_primitive(&floor, quad({-9, 0, 9}, {18, 0, 0}, {0, 0, -18}, white));
  add_primitive(&floor, quad({-0.1f, 1, 0.1f}, {0.2f, 0, 0}, {0, 0, -0.2f}, 1));
  render::PunctualLight light;
  light.intensity = {1, 1, 1};
  light.position = {0, 2, 0};
  floor.lights.push_back(light);
  look_at(&floor, {2, 1, 0}, {0, 0, 0});
  floor.camera.yfov = 1e-5;
  EXPECT_NEAR(seen(floor, Background::automatic).rgb.x, 1 / std::numbers::pi / 4, 1e-6);
}

TEST(CullBackfaces, HidesBacksFromCameraOnly) {
  Scene scene = empty_scene();
  Material m;
  m.unlit = true;
  const auto index = static_cast<std::size_t>(add_material(&scene, m));
  add_primitive(&scene,
                quad({9, -9, 0}, {-18, 0, 0}, {0, 18, 0}, static_cast<std::int32_t>(index)));
  auto settings = small_settings(2, 2, 4);
  EXPECT_EQ(render_picture(scene, settings).alpha[0], 1);
  settings.cull_backfaces = true;
  EXPECT_EQ(render_picture(scene, settings).alpha[0], 0);
  scene.materials[index].double_sided = true;
  EXPECT_EQ(render_picture(scene, settings).alpha[0], 1);
}

TEST(NonFiniteSamples, AreDroppedAndCounted) {  // hard case 70
  render::PixelSums sums;
  contract::FilmBlockShape shape;
  shape.width = shape.height = 1;
  contract::FilmBlock block = contract::FilmBlock::zeros(shape);
  // One sample in a million, of each of two replicates.
  for (int i = 0; i < 4'000'000; ++i) {
    render::PathResult path;
    path.radiance = {1, 2, 3};
    if (i == 40) path.radiance.y = std::numeric_limits<float>::quiet_NaN();
    if (i == 81) path.radiance.x = std::numeric_limits<float>::infinity();
    sums.add(path, i, 0);
  }
  sums.store(0, &block);
  EXPECT_EQ(sums.dropped(0), 1u);
  EXPECT_EQ(sums.dropped(1), 1u);
  EXPECT_EQ(block.rgb[1], 999'999 * 2.0f);
  EXPECT_EQ(block.rgb[3], 999'999 * 1.0f);
  EXPECT_EQ(block.alpha[0], 3'999'998);
}

TEST(NonFiniteSamples, CountsReachTheFilmBlock) {
  Scene scene = empty_scene();
  add_sheet(&scene, 0, add_material(&scene, lamp(std::numeric_limits<float>::infinity())));
  const Picture picture = render_picture(scene, small_settings(2, 1, 8));
  ASSERT_EQ(picture.blocks[0].dropped.size(), 8u);
  EXPECT_EQ(picture.blocks[0].dropped[5], (contract::DroppedSamples{1, 1, 2}));
  EXPECT_EQ(picture.blocks[0].rgb[0], 0);
}

TEST(Clamp, LimitsSamplesAndCountsRemovedEnergy) {  // hard case 80
  Scene scene = empty_scene();
  add_sheet(&scene, 0, add_material(&scene, lamp(5)));
  auto settings = small_settings(2, 2, 8);
  settings.clamp = 2;
  const Picture picture = render_picture(scene, settings);
  EXPECT_EQ(picture.mean(), 2);
  EXPECT_EQ(picture.blocks[0].clamped_energy, 3.0 * 3 * 4 * 8);
}

}  // namespace
}  // namespace tessera::testing
