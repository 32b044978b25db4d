#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "tests/support/plain_scene.h"
#include "worker/light/emitters/environment_map.h"
#include "worker/light/emitters/punctual.h"
#include "worker/light/light_sampler.h"

namespace tessera::testing {
namespace {

using render::Material;
using render::PunctualLight;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

constexpr double kPi = 3.14159265358979323846;

/// A wide floor at y = 0 and a camera above that sees a tiny spot of it.
Scene floor_scene(const Material& material, const Vec3d& looked_at) {
  Scene scene = empty_scene();
  const auto index = add_material(&scene, material);
  add_primitive(&scene, quad({-50, 0, 50}, {100, 0, 0}, {0, 0, -100}, index));
  look_at(&scene, looked_at + Vec3d{0.3, 4, 0.2}, looked_at);
  scene.camera.yfov = 1e-6;
  return scene;
}

PunctualLight point_light(float candela, const Vec3d& position) {
  PunctualLight light;
  light.intensity = {candela, candela, candela};
  light.position = position;
  return light;
}

double middle(Scene scene, int spp = 4, int max_depth = 1) {
  auto settings = small_settings(1, 1, spp);
  settings.max_depth = max_depth;
  return render_picture(std::move(scene), settings).at(0, 0).x;
}

TEST(Lighting, PointLightOnLambertMatchesFormula) {
  for (const Vec3d& at : {Vec3d{0, 0, 0}, Vec3d{1, 0, 2}, Vec3d{-7, 0, 0.5}}) {
    Scene scene = floor_scene(lambert({0.8f, 0.8f, 0.8f}), at);
    scene.lights.push_back(point_light(12, {0.5, 2, -1}));
    const Vec3d to_light = Vec3d{0.5, 2, -1} - at;
    const double d2 = dot(to_light, to_light);
    const double expected = 0.8 / kPi * 12 * (2 / std::sqrt(d2)) / d2;
    EXPECT_NEAR(middle(scene) / expected, 1, 1e-5);
  }
}

TEST(Lighting, OneCandelaAtOneMetreGivesOneOverPi) {  // hard case 60
  Scene scene = floor_scene(lambert({1, 1, 1}), {0, 0, 0});
  scene.lights.push_back(point_light(1, {0, 1, 0}));
  EXPECT_NEAR(middle(scene), 1 / kPi, 1e-6);
}

TEST(Lighting, RangeFollowsExtension) {  // hard case 62
  Scene scene = floor_scene(lambert({1, 1, 1}), {0, 0, 0});
  scene.lights.push_back(point_light(1, {0, 1, 0}));
  scene.lights[0].range = 2;
  EXPECT_NEAR(middle(scene), 0.9375 / kPi, 1e-6);
  scene.lights[0].range = 1;
  EXPECT_EQ(middle(scene), 0);
  const auto near_light = render::sample_punctual(point_light(1, {0, 1e-6, 0}), {0, 0, 0});
  EXPECT_NEAR(static_cast<double>(near_light.irradiance.x), 1e12, 1e7);
}

TEST(Lighting, SpotFallsOffBetweenCones) {
  Scene scene = floor_scene(lambert({1, 1, 1}), {1, 0, 0});
  PunctualLight spot = point_light(1, {0, 1, 0});
  spot.kind = PunctualLight::Kind::spot;
  spot.direction = {0, -1, 0};
  spot.cos_inner = 0.9f;
  spot.cos_outer = 0.5f;
  scene.lights.push_back(spot);
  const double cosine = std::sqrt(0.5);  // at 45 degrees, d^2 = 2
  const double share = (cosine - 0.5) / 0.4;
  EXPECT_NEAR(middle(scene), share * share * cosine / 2 / kPi, 1e-6);
  scene.lights[0].cos_outer = 0.75f;
  EXPECT_EQ(middle(scene), 0);
}

TEST(Lighting, DirectionalLightIsInLux) {
  Scene scene = floor_scene(lambert({0.5f, 0.5f, 0.5f}), {3, 0, 1});
  PunctualLight sun;
  sun.kind = PunctualLight::Kind::directional;
  sun.intensity = {100, 100, 100};
  sun.direction = normalize(Vec3f{1, -1, 0});
  scene.lights.push_back(sun);
  EXPECT_NEAR(middle(scene), 0.5 / kPi * 100 * std::sqrt(0.5), 1e-5 * 15);
}

Material lamp(float radiance) {
  Material m = lambert({0, 0, 0});
  m.emission = {radiance, radiance, radiance};
  return m;
}

TEST(Lighting, EmitterShowsRadianceFromFrontOnly) {  // hard case 61
  Scene scene = empty_scene();
  const auto index = add_material(&scene, lamp(7.5f));
  add_primitive(&scene, quad({-9, -9, 0}, {18, 0, 0}, {0, 18, 0}, index));
  EXPECT_EQ(middle(scene), 7.5);
  look_at(&scene, {0, 0, -5}, {0, 0, 0});
  EXPECT_EQ(middle(scene), 0);
  scene.materials[static_cast<std::size_t>(index)].double_sided = true;
  EXPECT_EQ(middle(scene), 7.5);
}

TEST(Lighting, MirroredEmittersKeepFrontSide) {  // hard case 27
  Scene scene = empty_scene();
  const auto index = add_material(&scene, lamp(2));
  add_primitive(&scene, quad({-9, -9, 0}, {18, 0, 0}, {0, 18, 0}, index), scaling(-1, 1, 1));
  EXPECT_EQ(middle(scene), 2);
}

TEST(Lighting, SquareFormFactorMatchesFormula) {  // hard case 58
  const double expected[] = {0.239456, 0.968340, 0.999673};
  const double heights[] = {1, 0.1, 0.01};
  for (int i = 0; i < 3; ++i) {
    Scene scene = empty_scene();  // the camera is between floor and lamp
    const auto white = add_material(&scene, lambert({1, 1, 1}));
    const auto light = add_material(&scene, lamp(1));
    const auto h = static_cast<float>(heights[i]);
    add_primitive(&scene, quad({-50, 0, 50}, {100, 0, 0}, {0, 0, -100}, white));
    add_primitive(&scene, quad({-0.5f, h, -0.5f}, {1, 0, 0}, {0, 0, 1}, light));
    look_at(&scene, {0.001 * heights[i], 0.5 * heights[i], 0}, {0, 0, 0});
    scene.camera.yfov = 1e-3;
    EXPECT_NEAR(middle(scene, 1024), expected[i], 2e-3) << heights[i];
  }
}

/// Density of light samples over solid angle times the solid angle, for both halves of an emissive
/// parallelogram one metre above.
std::array<double, 2> shares_of_halves(const Vec3f& along_t) {
  Scene scene = empty_scene();
  const auto material = add_material(&scene, lamp(1));
  const Vec3f a = {-0.5f, 1, -0.5f}, s = {0, 0, 1}, t = along_t;
  add_primitive(&scene, quad(a, t, s, material));
  const render::ShadingScene shading(scene);
  const render::LightSampler lights(scene, shading);
  const Vec3d b(a + t), c(a + t + s), d(a + s);
  const double halves = render::SphericalTriangle::seen_from_origin(Vec3d(a), b, c).solid_angle +
                        render::SphericalTriangle::seen_from_origin(Vec3d(a), c, d).solid_angle;
  const render::LightSampleContext context{{0, 0, 0}, {0, 1, 0}, false};
  const auto density = [&](std::uint32_t half) {
    return static_cast<double>(lights.emitter_pdf(context, {0, 0, half}, 1, 1));
  };
  return {density(0) * halves, density(1) * halves};
}

TEST(Lighting, RectangleHalvesAreOneLight) {
  for (const double share : shares_of_halves({1, 0, 0})) EXPECT_NEAR(share, 1, 1e-6);
  // A slanted parallelogram is not one light: its halves are seen under other angles.
  const auto leaning = shares_of_halves({1, 0, 0.5f});
  EXPECT_GT(std::fabs(leaning[0] - leaning[1]), 0.1);
}

TEST(Lighting, ClosedFurnaceSumsBounces) {  // hard case 45
  Material wall = lambert({0.5f, 0.5f, 0.5f});
  wall.emission = {0.5f, 0.5f, 0.5f};
  Scene scene = empty_scene();
  const auto index = add_material(&scene, wall);
  add_primitive(&scene, box({-6, -6, -6}, {6, 6, 6}, true, index));
  for (const int depth : {1, 2, 8}) {
    auto settings = small_settings(8, 8, 64);
    settings.max_depth = depth;
    const Picture picture = render_picture(scene, settings);
    const double expected = 1 - std::pow(0.5, depth + 1);
    // Grey light: the errors of the three channels are equal, not independent.
    const double error = std::sqrt(3) * picture.mean_error();
    EXPECT_NEAR(picture.mean(), expected, 4 * error + 1e-6) << depth;
    EXPECT_LT(error, 5e-3);
  }
}

TEST(Lighting, ClosedFurnaceReportsTruncatedEnergy) {  // hard case 45
  Material wall = lambert({0.99f, 0.99f, 0.99f});
  wall.emission = {0.5f, 0.5f, 0.5f};
  Scene scene = empty_scene();
  const auto index = add_material(&scene, wall);
  add_primitive(&scene, box({-6, -6, -6}, {6, 6, 6}, true, index));
  for (const int depth : {8, 64}) {
    auto settings = small_settings(32, 32, 64);
    settings.max_depth = depth;
    const Picture picture = render_picture(scene, settings);
    double truncated = 0;
    for (const contract::FilmBlock& block : picture.blocks) truncated += block.truncated_energy;
    const double samples = 32 * 32 * 64;
    const double expected = 50 * std::pow(0.99, depth + 1);
    // Each path continues with probability 1/64 and then contributes about 64 times `expected`;
    // this is the variance of that choice. Russian roulette and path ends add as much again at
    // most.
    const double error = expected * std::sqrt(2 * 64 / samples);
    EXPECT_NEAR(truncated / (3 * samples), expected, 4 * error) << depth;
    EXPECT_NEAR(picture.mean(), 50 - expected, 4 * std::sqrt(3) * picture.mean_error()) << depth;
  }
}

TEST(Lighting, OpenSceneTruncatesNoEnergy) {
  Scene scene = floor_scene(lambert({1, 1, 1}), {0, 0, 0});
  for (const contract::FilmBlock& block : render_picture(scene, small_settings(8, 8, 64)).blocks) {
    EXPECT_EQ(block.truncated_energy, 0);
  }
}

TEST(Lighting, MirrorShowsReflectedLamp) {  // hard case 60
  Scene scene = empty_scene();
  Material mirror = metal(0);
  const auto m = add_material(&scene, mirror);
  const auto l = add_material(&scene, lamp(3));
  add_primitive(&scene, quad({-5, -5, 0}, {10, 0, 0}, {0, 10, 0}, m));
  add_primitive(&scene, quad({20, -20, 8}, {-40, 0, 0}, {0, 40, 0}, l));
  EXPECT_NEAR(middle(scene), 3, 1e-6);
}

TEST(Lighting, ConstantSkyLightsWhiteFloorEqually) {  // hard case 56
  Scene scene = floor_scene(lambert({1, 1, 1}), {0, 0, 0});
  set_constant_sky(&scene, 2);
  EXPECT_NEAR(middle(scene, 16), 2, 1e-6);
  // The same sky as an image is sampled and gives the same result.
  std::vector<float> texels(64 * 32 * 3, 2.0f);
  set_sky(&scene, 64, 32, texels);
  const Picture picture = render_picture(scene, small_settings(4, 4, 256));
  EXPECT_NEAR(picture.mean(), 2, 4 * picture.mean_error());
  EXPECT_LT(picture.mean_error(), 6e-3);
}

TEST(Lighting, BrightSkyTexelLightsFloor) {  // hard case 55
  constexpr int kWidth = 512, kHeight = 256, kRow = 75, kColumn = 130;
  std::vector<float> texels(kWidth * kHeight * 3, 1e-3f);
  for (int c = 0; c < 3; ++c)
    texels[(kRow * kWidth + kColumn) * 3 + static_cast<std::size_t>(c)] = 1e5f;
  Scene scene = floor_scene(lambert({1, 1, 1}), {0, 0, 0});
  set_sky(&scene, kWidth, kHeight, texels);
  // Irradiance: the bilinear filter of the texel times cos(theta) sin(theta), in double.
  double irradiance = 1e-3 * kPi;
  constexpr int kSub = 400;
  for (int k = 0; k < kSub; ++k) {
    const double y = -1 + 2 * (k + 0.5) / kSub;
    const double v = (kRow + 0.5 + y) / kHeight * kPi;
    irradiance += (1 - std::fabs(y)) * std::cos(v) * std::sin(v) * (2.0 / kSub) * (kPi / kHeight) *
                  (2 * kPi / kWidth) * (1e5 - 1e-3);
  }
  auto settings = small_settings(8, 8, 256);
  settings.max_depth = 1;
  // One sample in a thousand goes to the dim remainder: 16,384 samples are precise to 2.5e-4.
  EXPECT_NEAR(render_picture(scene, settings).mean() / (irradiance / kPi), 1, 1e-3);
}

TEST(Lighting, SkyTexelAppearsInPredictedDirection) {
  constexpr int kWidth = 64, kHeight = 32;
  for (const double degrees : {0.0, 90.0, 37.5}) {
    for (const Vec3d& d : {Vec3d{1, 0.2, 0.1}, Vec3d{-0.3, -0.8, -1}, Vec3d{0.1, 1, 2}}) {
      const Vec3d dir = normalize(d);
      double u = 0.5 + std::atan2(dir.z, dir.x) / (2 * kPi) + degrees / 360;
      u -= std::floor(u);
      const double v = std::acos(dir.y) / kPi;
      const int column = static_cast<int>(u * kWidth), row = static_cast<int>(v * kHeight);
      std::vector<float> texels(kWidth * kHeight * 3, 0.0f);
      const auto at = static_cast<std::size_t>(row * kWidth + column) * 3;
      texels[at] = 1;
      Scene scene = empty_scene();
      set_sky(&scene, kWidth, kHeight, texels);
      scene.environment.rotation_degrees = degrees;
      // Bilinear weights of the texel at the exact point.
      const double wx = 1 - std::fabs(u * kWidth - column - 0.5);
      const double wy = 1 - std::fabs(v * kHeight - row - 0.5);
      look_at(&scene, {0, 0, 0}, dir);
      scene.camera.yfov = 1e-5;
      const Picture picture = render_picture(scene, small_settings(1, 1, 1));
      EXPECT_NEAR(picture.at(0, 0).x, wx * wy, 1e-4);
      EXPECT_EQ(picture.at(0, 0).y, 0);
    }
  }
}

/// Direction i of `count` directions spread evenly over the sphere.
Vec3f spread(int i, int count) {
  const double z = 1 - 2 * (i + 0.5) / count, phi = i * 2.399963229728653;
  const double r = std::sqrt(1 - z * z);
  return Vec3f(Vec3d{r * std::cos(phi), z, r * std::sin(phi)});
}

TEST(Environment, SamplesFollowPdf) {  // hard cases 55, 56
  std::vector<float> texels(32 * 16 * 3);
  for (std::size_t i = 0; i < texels.size(); ++i)
    texels[i] = i % 7 == 0 ? 0.0f : static_cast<float>(i % 13);
  for (int c = 0; c < 3; ++c) texels[static_cast<std::size_t>(c)] = 500;  // at the pole
  Scene scene;
  set_sky(&scene, 32, 16, texels);
  const render::EnvironmentMap map(scene);
  double sum = 0, sampled = 0, left = 0, density = 0;
  constexpr int kSide = 300, kSphere = 400'000;
  for (int i = 0; i < kSide * kSide; ++i) {
    const int row = i / kSide, column = i % kSide;
    const auto s = map.sample((row + 0.5) / kSide, (column + 0.5) / kSide);
    ASSERT_NEAR(static_cast<double>(length(s.direction)), 1, 1e-6);
    // Away from texel edges pdf() returns the density of the sample.
    const float back = map.pdf(s.direction);
    sum += static_cast<double>(back / s.pdf);
    sampled += static_cast<double>(luminance(s.radiance) / s.pdf) / (kSide * kSide);
  }
  for (int i = 0; i < kSphere; ++i) {
    const auto found = map.look_up(spread(i, kSphere));
    density += static_cast<double>(found.pdf) * 4 * kPi / kSphere;
    if (!(found.pdf > 0)) left += luminance(found.radiance) * 4 * kPi / kSphere;
  }
  EXPECT_NEAR(sum / (kSide * kSide), 1, 1e-3);
  EXPECT_NEAR(density, 1, 2e-3);
  // Light samples find directions with density, BSDF samples those without; together they find all.
  EXPECT_NEAR((sampled + left) / map.power(), 1, 1e-2);
  EXPECT_GT(left, 0.01 * map.power());
}

TEST(Environment, BrightTexelsAreSampled) {  // hard case 66
  std::vector<float> texels(16 * 8 * 3, 0.0f);
  texels[(3 * 16 + 0) * 3] = 1e-6f;  // its filter wraps around the seam
  Scene scene;
  set_sky(&scene, 16, 8, texels);
  const render::EnvironmentMap map(scene);
  const double mean = map.power() / (4 * kPi);
  int lit = 0;
  for (int i = 0; i < 20000; ++i) {
    const auto found = map.look_up(spread(i, 20000));
    if (!(luminance(found.radiance) > mean * 1.0001)) continue;
    ++lit;
    ASSERT_GT(found.pdf, 0);
  }
  EXPECT_GT(lit, 100);
}

TEST(Environment, UniformImageCountsAsConstantSky) {
  for (const float radiance : {1e-30f, 0.3f, 1.7f, 1e20f}) {
    Scene scene;
    set_sky(&scene, 37, 19, std::vector<float>(37 * 19 * 3, radiance));
    EXPECT_TRUE(render::EnvironmentMap(scene).is_constant()) << radiance;
  }
}

}  // namespace
}  // namespace tessera::testing
