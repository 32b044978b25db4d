// The full estimator against an independent slow one without light sampling, whose paths hit the
// lights: both give the same image, or one is biased.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numeric>
#include <string>
#include <vector>

#include "tests/support/scene/folder_reader.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/gltf/build/loader.h"
#include "worker/light/light_sampler.h"
#include "worker/render/path/path_tracer.h"

namespace tessera::testing {
namespace {

using render::LightSampler;
using render::Scene;
using render::Vec3f;

constexpr std::int32_t kSize = 16, kBlock = 4;
constexpr std::size_t kBlocks = (kSize / kBlock) * (kSize / kBlock), kValues = 3 * kBlocks;
constexpr std::uint32_t kSeeds = 16;

/// Means of R, G, B of each block of pixels.
using Blocks = std::array<double, kValues>;

/// Renders frames with a light sampling mode.
class Estimator {
 public:
  Estimator(const Scene& scene, LightSampler::LightSampling sampling)
      : scene_(scene),
        shading_(scene),
        accel_(scene, render::sequential()),
        lights_(scene, shading_, sampling),
        camera_(scene.camera, kSize, kSize) {}

  Blocks render(std::uint32_t seed, std::int32_t spp) {
    const bool moves = !scene_.key_times.empty() || !scene_.camera.keys.empty();
    const render::FrameContext context{
        shading_, accel_, lights_, camera_, filter_, contract::Background::automatic, {}, 8,
        false,    seed,   0,       0,       moves};
    Blocks blocks{};
    for (std::int32_t i = 0; i < kSize * kSize; ++i) {
      const std::int32_t x = i % kSize, y = i / kSize;
      const auto block = static_cast<std::size_t>(y / kBlock * (kSize / kBlock) + x / kBlock);
      for (std::int32_t sample = 0; sample < spp; ++sample) {
        const render::PathId id{x, y, sample};
        render::PathResult path;
        render::trace_paths(context, std::span(&id, 1), &scratch_, &path);
        const double share = 1.0 / (kBlock * kBlock * spp);
        blocks[3 * block] += static_cast<double>(path.radiance.x) * share;
        blocks[3 * block + 1] += static_cast<double>(path.radiance.y) * share;
        blocks[3 * block + 2] += static_cast<double>(path.radiance.z) * share;
      }
    }
    return blocks;
  }

 private:
  const Scene& scene_;
  const render::ShadingScene shading_;
  const render::SceneAccel accel_;
  const LightSampler lights_;
  const render::CameraRays camera_;
  const render::PixelFilterSampler filter_{contract::PixelFilter::box, 1};
  render::PathScratch scratch_;
};

/// Means over seeds, and the variances of the means.
struct Figures {
  Blocks mean{}, variance{};
};

Figures figures(const Scene& scene, LightSampler::LightSampling sampling, std::uint32_t first_seed,
                std::int32_t spp) {
  Estimator estimator(scene, sampling);
  Figures f;
  for (std::uint32_t i = 0; i < kSeeds; ++i) {
    const Blocks blocks = estimator.render(first_seed + i, spp);
    for (std::size_t k = 0; k < kValues; ++k) {
      const double difference = blocks[k] - f.mean[k];
      f.mean[k] += difference / (i + 1);
      f.variance[k] += difference * (blocks[k] - f.mean[k]) / (kSeeds * (kSeeds - 1.0));
    }
  }
  return f;
}

/// Welch's t with the degrees of freedom of Welch and Satterthwaite, converted to a normal deviate
/// (D. L. Wallace, "Bounds on normal approximations to Student's and the chi-square distributions",
/// 1959).
double deviate(double a, double variance_a, double b, double variance_b) {
  const double variance = variance_a + variance_b;
  if (!(variance > 0)) return a == b ? 0 : 1e9;
  const double t = (a - b) / std::sqrt(variance);
  const double freedom =
      variance * variance * (kSeeds - 1) / (variance_a * variance_a + variance_b * variance_b);
  const double z =
      std::sqrt(freedom * std::log1p(t * t / freedom)) * (8 * freedom + 1) / (8 * freedom + 3);
  return t < 0 ? -z : z;
}

/// Tests each block, with one false alarm in 1,000 for all together (Šidák: one tail of z > 3.9 has
/// 1.4e-5 for each of 48 blocks), and their mean, which shows a bias that is small everywhere.
void expect_agreement(const Scene& scene, std::int32_t spp, std::int32_t slow_spp) {
  ASSERT_TRUE(scene.lights.empty()) << "a light that rays cannot hit";
  const Figures full = figures(scene, LightSampler::LightSampling::all, 1, spp);
  const Figures slow = figures(scene, LightSampler::LightSampling::none, 1'000, slow_spp);
  double sum = 0, light = 0;
  for (std::size_t k = 0; k < kValues; ++k) {
    const double z = deviate(full.mean[k], full.variance[k], slow.mean[k], slow.variance[k]);
    EXPECT_LT(std::fabs(z), 4.3) << "block " << k / 3 << " channel " << k % 3 << ": "
                                 << full.mean[k] << " and, found by chance, " << slow.mean[k];
    sum += z;
    light += slow.mean[k];
  }
  EXPECT_GT(light, 0);
  // The channels of a block are correlated: at worst a third of the deviates is independent.
  EXPECT_LT(std::fabs(sum / kValues) * std::sqrt(kValues / 3.0), 3.3);
}

/// A scene of tests/scenes without its punctual lights.
Scene scene_of_file(const std::string& name) {
  FolderReader reader(std::string(TESSERA_SCENES));
  contract::RenderSettings settings = small_settings(kSize, kSize, 4);
  auto file = render::load_scene_file(name + ".gltf", settings, reader);
  EXPECT_TRUE(file.ok()) << file.status();
  auto scene = (*file)->pose(settings, 0);
  EXPECT_TRUE(scene.ok()) << scene.status();
  scene->lights.clear();
  return *std::move(scene);
}

TEST(Estimators, AgreeOnGlassMetalAndPaint) {
  expect_agreement(scene_of_file("quickstart"), 8, 32);
}

TEST(Estimators, AgreeOnEveryMaterialExtension) {
  expect_agreement(scene_of_file("materials"), 8, 32);
}

TEST(Estimators, AgreeOnShapesAndCsg) {
  expect_agreement(scene_of_file("shapes"), 8, 32);
  expect_agreement(scene_of_file("csg"), 8, 32);
}

TEST(Estimators, AgreeInFog) {
  expect_agreement(scene_of_file("fog"), 8, 32);
}

TEST(Estimators, AgreeOnMotionBlur) {
  expect_agreement(scene_of_file("motion"), 8, 32);
}

// A small lamp that shines down moves over a floor and makes a quarter turn.
TEST(Estimators, MovingLampsAreSampled) {
  Scene scene = empty_scene();
  render::Material lamp = lambert({0.5f, 0.5f, 0.5f});
  lamp.emission = {40, 30, 20};
  const auto light = add_material(&scene, lamp);
  add_primitive(&scene, quad({-3, -1, 3}, {6, 0, 0}, {0, 0, -6},
                             add_material(&scene, lambert({0.7f, 0.6f, 0.5f}))));
  const auto moves = add_primitive(&scene, quad({0, 0, 0}, {0.2f, 0, 0}, {0, 0, 0.2f}, light));
  scene.instances[static_cast<std::size_t>(moves)].motion = 0;
  render::Affine3d turned = translation(1, 0.3, 0.5);
  turned.rows = {render::Vec3d{0, 0, 1}, render::Vec3d{0, 1, 0}, render::Vec3d{-1, 0, 0}};
  scene.key_times = {0, 1};
  scene.motions = {{translation(-1, 0, 0), turned}};
  look_at(&scene, {0, 0.6, 5}, {0, -0.4, 0});
  expect_agreement(scene, 16, 128);
  const Figures full = figures(scene, LightSampler::LightSampling::all, 1, 16);
  const Figures slow = figures(scene, LightSampler::LightSampling::none, 1'000, 16);
  const double noise = std::accumulate(full.variance.begin(), full.variance.end(), 0.0);
  EXPECT_LT(noise * 10, std::accumulate(slow.variance.begin(), slow.variance.end(), 0.0));
}

/// Small bodies of glowing gas over a floor, in fog: a clear one, a dense one and one that scatters
/// and moves; each of varying density or not.
Scene glowing_bodies(bool noise) {
  Scene scene = empty_scene();
  add_primitive(&scene, quad({-3, -1, 3}, {6, 0, 0}, {0, 0, -6},
                             add_material(&scene, lambert({0.7f, 0.6f, 0.5f}))));
  render::ProceduralTexture texture;
  texture.scale = {6, 6, 6};
  texture.ramp = {{0.3f, {0, 0, 0, 1}}, {0.7f, {2, 2, 2, 1}}};
  scene.procedural_textures.push_back(texture);
  const auto add = [&](const render::Medium& medium, float size, const render::Affine3d& at) {
    render::Material material = lambert({0, 0, 0});
    material.medium = medium;
    if (noise) material.medium->procedural = 0;
    const auto index = add_material(&scene, material);
    return add_primitive(&scene, box({-size, -size, -size}, {size, size, size}, false, index), at);
  };
  render::Medium gas;
  gas.emission = {90, 40, 20};
  add(gas, 0.1f, translation(-1, -0.3, 0));
  gas.absorption = {30, 20, 40};
  add(gas, 0.15f, translation(0, -0.4, -1));
  gas.scattering = {5, 9, 7};
  const auto moves = add(gas, 0.1f, translation(1, -0.5, 0.5));
  scene.instances[static_cast<std::size_t>(moves)].motion = 0;
  scene.key_times = {0, 1};
  scene.motions = {{translation(0.8, -0.5, 0.5), translation(1.3, -0.3, 0.2)}};
  scene.atmosphere = render::Atmosphere{{}, {0, 0, 0}, 6};
  scene.atmosphere->medium.scattering = {0.03f, 0.03f, 0.03f};
  look_at(&scene, {0, 0.6, 5}, {0, -0.4, 0});
  return scene;
}

/// Variance of the first and last row of blocks, where the camera sees none of these bodies.
double variance_beside_bodies(const Figures& f) {
  constexpr auto kRow = static_cast<std::ptrdiff_t>(kValues / (kSize / kBlock));
  const double above = std::accumulate(f.variance.begin(), f.variance.begin() + kRow, 0.0);
  return above + std::accumulate(f.variance.end() - kRow, f.variance.end(), 0.0);
}

TEST(Estimators, GlowingBodiesAreSampled) {
  for (const bool noise : {false, true}) {
    const Scene scene = glowing_bodies(noise);
    expect_agreement(scene, 16, 128);
    const Figures full = figures(scene, LightSampler::LightSampling::all, 1, 16);
    const Figures slow = figures(scene, LightSampler::LightSampling::none, 1'000, 16);
    const double gain = variance_beside_bodies(slow) / variance_beside_bodies(full);
    EXPECT_GT(gain, 10) << noise;
    RecordProperty(noise ? "gain_noise" : "gain", std::to_string(gain));
  }
}

// Light and BSDF sampling both find the lamp often, so their weights matter.
TEST(Estimators, AgreeOnRoughMetalUnderLargeLamp) {
  Scene scene = empty_scene();
  render::Material lamp = lambert({0.5f, 0.5f, 0.5f});
  lamp.emission = {2, 2, 2};
  const auto light = add_material(&scene, lamp);
  add_primitive(&scene,
                quad({-3, -1, 3}, {6, 0, 0}, {0, 0, -6}, add_material(&scene, metal(0.4f))));
  add_primitive(&scene, sphere({0, -0.3f, 0}, 0.7f, 16, add_material(&scene, metal(0.7f))));
  add_primitive(&scene, quad({-2, 1.2f, -2}, {4, 0, 0}, {0, 0, 4}, light));
  look_at(&scene, {0, 0.6, 5}, {0, -0.4, 0});
  expect_agreement(scene, 16, 32);
}

TEST(Estimators, AgreeUnderSkyWithBrightSpot) {
  Scene scene = empty_scene();
  add_primitive(&scene, quad({-3, -1, 3}, {6, 0, 0}, {0, 0, -6},
                             add_material(&scene, lambert({0.7f, 0.5f, 0.4f}))));
  add_primitive(&scene, sphere({-0.6f, -0.4f, 0}, 0.6f, 16, add_material(&scene, metal(0.5f))));
  add_primitive(&scene, sphere({0.8f, -0.4f, 0}, 0.6f, 16,
                               add_material(&scene, lambert({0.4f, 0.6f, 0.8f}))));
  std::vector<float> sky(32 * 16 * 3, 0.3f);
  for (std::size_t c = 0; c < 3; ++c) sky[3 * (4 * 32 + 9) + c] = 30;
  set_sky(&scene, 32, 16, sky);
  look_at(&scene, {0, 1, 5}, {0, -0.3, 0});
  expect_agreement(scene, 8, 32);
}

}  // namespace
}  // namespace tessera::testing
