#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "tests/support/scene/plain_scene.h"
#include "worker/light/emitters/punctual.h"
#include "worker/light/light_sampler.h"

namespace tessera::testing {
namespace {

using render::Material;
using render::PunctualLight;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

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
    const double expected = 0.8 / std::numbers::pi * 12 * (2 / std::sqrt(d2)) / d2;
    EXPECT_NEAR(middle(scene) / expected, 1, 1e-5);
  }
}

TEST(Lighting, OneCandelaAtOneMetreGivesOneOverPi) {  // hard case 60
  Scene scene = floor_scene(lambert({1, 1, 1}), {0, 0, 0});
  scene.lights.push_back(point_light(1, {0, 1, 0}));
  EXPECT_NEAR(middle(scene), 1 / std::numbers::pi, 1e-6);
}

TEST(Lighting, RangeFollowsExtension) {  // hard case 62
  Scene scene = floor_scene(lambert({1, 1, 1}), {0, 0, 0});
  scene.lights.push_back(point_light(1, {0, 1, 0}));
  scene.lights[0].range = 2;
  EXPECT_NEAR(middle(scene), 0.9375 / std::numbers::pi, 1e-6);
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
  EXPECT_NEAR(middle(scene), share * share * cosine / 2 / std::numbers::pi, 1e-6);
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
  EXPECT_NEAR(middle(scene), 0.5 / std::numbers::pi * 100 * std::sqrt(0.5), 1e-5 * 15);
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

/// View factor of a unit square seen from the point at distance `h` under its centre, parallel to
/// it.
double square_factor(double h) {
  const double a = 0.5 / h, b = a / std::sqrt(1 + a * a);
  return 4 / std::numbers::pi * b * std::atan(b);
}

TEST(Lighting, SquareFormFactorMatchesFormula) {  // hard case 58
  EXPECT_NEAR(square_factor(1), 0.239456, 5e-7);
  EXPECT_NEAR(square_factor(0.01), 0.999673, 5e-7);
  for (const double height : {1.0, 0.1, 0.01, 0.001}) {
    Scene scene = empty_scene();  // the camera is between floor and lamp
    const auto white = add_material(&scene, lambert({1, 1, 1}));
    const auto light = add_material(&scene, lamp(1));
    const auto h = static_cast<float>(height);
    add_primitive(&scene, quad({-50, 0, 50}, {100, 0, 0}, {0, 0, -100}, white));
    add_primitive(&scene, quad({-0.5f, h, -0.5f}, {1, 0, 0}, {0, 0, 1}, light));
    look_at(&scene, {0.001 * height, 0.5 * height, 0}, {0, 0, 0});
    scene.camera.yfov = 1e-3;
    auto settings = small_settings(1, 1, 1024);
    settings.max_depth = 1;
    constexpr int kSeeds = 32;
    double sum = 0, squares = 0;
    for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
      settings.seed = seed;
      const double off = render_picture(scene, settings).at(0, 0).x - square_factor(height);
      sum += off;
      squares += off * off;
    }
    // Each value is the mean of 1,024 samples, with a standard deviation of up to 1.7e-3.
    const double error = std::sqrt(squares / kSeeds / kSeeds);
    EXPECT_LT(std::fabs(sum / kSeeds), 4 * error + 1e-6) << height;
    EXPECT_LT(error, 4e-4) << height;
    EXPECT_LT(std::fabs(sum / kSeeds), 1e-3) << height;
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
    auto settings = small_settings(64, 64, depth == 8 ? 1152 : 64);
    settings.max_depth = depth;
    const Picture picture = render_picture(scene, settings);
    const double expected = 1 - std::pow(0.5, depth + 1);
    // Grey light: the errors of the three channels are equal, not independent.
    const double error = std::sqrt(3) * picture.mean_error();
    EXPECT_NEAR(picture.mean(), expected, 4 * error + 1e-6) << depth;
    EXPECT_LT(error, depth == 8 ? 1e-4 : 1e-3);
  }
}

TEST(Lighting, ClosedFurnaceReportsTruncatedEnergy) {  // hard case 45
  Material wall = lambert({0.99f, 0.99f, 0.99f});
  wall.emission = {0.5f, 0.5f, 0.5f};
  Scene scene = empty_scene();
  const auto index = add_material(&scene, wall);
  add_primitive(&scene, box({-6, -6, -6}, {6, 6, 6}, true, index));
  for (const int depth : {8, 64, 255}) {
    auto settings = small_settings(32, 32, 64);
    settings.max_depth = depth;
    const Picture picture = render_picture(scene, settings);
    double truncated = 0;
    for (const contract::FilmBlock& block : picture.blocks) truncated += block.truncated_energy;
    const double samples = 32 * 32 * 64;
    const double expected = 50 * std::pow(0.99, depth + 1);  // 3.8157 for 255
    // Russian roulette ends all but expected / 50 of the paths before. One in 64 of the others
    // continues and contributes 64 times 50; this is the variance of that choice. The random end
    // of a path adds as much again.
    const double error = std::sqrt(2 * 64 * 50 * expected / samples);
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

}  // namespace
}  // namespace tessera::testing
