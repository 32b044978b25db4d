// Path guiding changes the noise of an image, not its expected values, and is the same for any
// number of threads.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "tests/support/scene/plain_scene.h"
#include "worker/guide/photon_chains.h"
#include "worker/guide/photon_source.h"
#include "worker/guide/photon_store.h"
#include "worker/guide/photon_trace.h"
#include "worker/render/parallel_threads.h"

namespace tessera::testing {
namespace {

using render::Material;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

std::int32_t add_lamp(Scene* scene, float radiance, const Vec3f& corner, float side) {
  return add_primitive(
      scene, quad(corner, {side, 0, 0}, {0, 0, side}, add_material(scene, lamp(radiance))));
}

void add_floor(Scene* scene, const Material& material) {
  add_primitive(scene, quad({-3, -1, 3}, {6, 0, 0}, {0, 0, -6}, add_material(scene, material)));
}

/// A glass ball between a large lamp and a floor.
Scene caustic() {
  Scene scene = empty_scene();
  add_floor(&scene, lambert({0.6f, 0.6f, 0.6f}));
  add_primitive(&scene, sphere({0, 0, 0}, 0.7f, 24, add_material(&scene, glass(1.5f))));
  add_lamp(&scene, 16, {0.2f, 2.2f, -0.5f}, 1);
  look_at(&scene, {0, 1.6, 5}, {0, -0.4, 0});
  return scene;
}

/// A floor lit by a small lamp inside a glass ball.
Scene caged_lamp() {
  Scene scene = empty_scene();
  add_floor(&scene, lambert({0.6f, 0.6f, 0.6f}));
  add_primitive(&scene, sphere({0, 0, 0}, 0.4f, 24, add_material(&scene, glass(1.5f))));
  add_lamp(&scene, 400, {-0.05f, 0, -0.05f}, 0.1f);
  look_at(&scene, {0, 1.6, 5}, {0, -0.4, 0});
  return scene;
}

/// A room that an environment lights through a hole, and a large lamp in it, which light sampling,
/// BSDF sampling and the guide all find.
Scene room_with_window() {
  Scene scene = empty_scene();
  Material white = lambert({0.7f, 0.6f, 0.5f});
  white.double_sided = true;
  const auto wall = add_material(&scene, white);
  for (const auto& shape : {quad({-2, -1, 2}, {4, 0, 0}, {0, 0, -4}, wall),
                            quad({-2, 2, -2}, {4, 0, 0}, {0, 0, 4}, wall),
                            quad({-2, -1, -2}, {4, 0, 0}, {0, 3, 0}, wall),
                            quad({2, -1, -2}, {0, 0, 4}, {0, 3, 0}, wall),
                            quad({-2, -1, 2}, {0, 0, -4}, {0, 1.8f, 0}, wall)}) {
    add_primitive(&scene, shape);
  }
  add_primitive(&scene, sphere({0.6f, -0.4f, 0}, 0.6f, 16, add_material(&scene, metal(0.5f))));
  add_lamp(&scene, 0.5f, {-1, 1.5f, -1}, 1.5f);
  scene.has_environment = true;
  scene.environment.constant = {3, 3, 3};
  look_at(&scene, {0.3, 0.5, 6}, {0, 0.3, 0});
  return scene;
}

/// A closed room on a large ground, which the sky lights through a window in its right wall.
Scene closed_room(float window_width = 1.6f) {
  Scene scene = empty_scene();
  Material white = lambert({0.7f, 0.7f, 0.7f});
  white.double_sided = true;
  const auto wall = add_material(&scene, white);
  const float beside = 0.5f * (4 - window_width);
  for (const auto& shape : {quad({-2, -1, 2}, {4, 0, 0}, {0, 0, -4}, wall),
                            quad({-2, 2, -2}, {4, 0, 0}, {0, 0, 4}, wall),
                            quad({-2, -1, -2}, {4, 0, 0}, {0, 3, 0}, wall),
                            quad({-2, -1, 2}, {4, 0, 0}, {0, 3, 0}, wall),
                            quad({-2, -1, -2}, {0, 0, 4}, {0, 3, 0}, wall),
                            quad({2, -1, -2}, {0, 0, 4}, {0, 0.8f, 0}, wall),
                            quad({2, 1.2f, -2}, {0, 0, 4}, {0, 0.8f, 0}, wall),
                            quad({2, -0.2f, -2}, {0, 0, beside}, {0, 1.4f, 0}, wall),
                            quad({2, -0.2f, 2 - beside}, {0, 0, beside}, {0, 1.4f, 0}, wall),
                            quad({-9, -1.1f, 9}, {18, 0, 0}, {0, 0, -18}, wall)}) {
    add_primitive(&scene, shape);
  }
  scene.has_environment = true;
  scene.environment.constant = {3, 3, 3};
  look_at(&scene, {-1, 0.5, 1.8}, {0, 0, -1});
  return scene;
}

/// Tinted and rough glass, smooth paint over a diffuse base, and a pane with holes, under a sky and
/// a point light.
Scene mixed() {
  Scene scene = empty_scene();
  Material paint = lambert({0.7f, 0.5f, 0.3f});
  paint.specular = 1;
  paint.roughness = 0;
  add_floor(&scene, paint);
  Material clear = glass(1.5f);
  clear.attenuation_color = {0.9f, 0.5f, 0.8f};
  clear.attenuation_distance = 1;
  add_primitive(&scene, sphere({-0.8f, -0.2f, 0}, 0.7f, 24, add_material(&scene, clear)));
  Material frosted = glass(1.4f);
  frosted.roughness = 0.3f;
  add_primitive(&scene, sphere({0.9f, -0.3f, 0.3f}, 0.6f, 24, add_material(&scene, frosted)));
  Material pane = glass(1.5f);
  pane.has_volume = false;
  pane.base_color = {0.9f, 0.9f, 0.7f, 0.75f};
  pane.alpha_mode = render::AlphaMode::blend;
  add_primitive(&scene, quad({-1, -1, 1.2f}, {2, 0, 0}, {0, 1.5f, 0}, add_material(&scene, pane)));
  add_lamp(&scene, 60, {0.5f, 2.2f, -0.2f}, 0.4f);
  std::vector<float> sky(32 * 16 * 3);
  for (std::size_t i = 0; i < sky.size(); ++i) sky[i] = static_cast<float>(i % 11) * 0.05f;
  set_sky(&scene, 32, 16, sky);
  render::PunctualLight point;
  point.intensity = {3, 3, 3};
  point.position = {1.5, 1.5, 1.5};
  scene.lights.push_back(point);
  look_at(&scene, {0.5, 1, 5}, {0, -0.2, 0});
  return scene;
}

std::string bytes(const Picture& picture) {
  std::string all;
  for (const auto& block : picture.blocks) all += contract::encode(block);
  return all;
}

contract::RenderSettings settings_for(std::int32_t spp, bool guiding) {
  auto settings = small_settings(24, 20, spp);
  settings.guiding = guiding;
  settings.max_depth = 8;
  return settings;
}

/// Renders with and without guiding, expects equal means within four standard errors, and returns
/// by how much guiding lowers the variance of the mean.
double expect_same_mean(const Scene& scene, std::int32_t spp, std::int32_t plain_spp) {
  const Picture plain = render_picture(scene, settings_for(plain_spp, false));
  const Picture guided = render_picture(scene, settings_for(spp, true));
  const double error = std::hypot(plain.mean_error(), guided.mean_error());
  EXPECT_LT(std::fabs(plain.mean() - guided.mean()), 4 * error)
      << plain.mean() << ", guided " << guided.mean();
  EXPECT_LT(largest_difference(plain, guided), 4.5);
  EXPECT_NE(bytes(plain), bytes(guided));
  const double ratio = plain.mean_error() / guided.mean_error();
  return ratio * ratio * plain_spp / spp;
}

TEST(Guiding, CausticHasSameMean) {
  RecordProperty("gain", std::to_string(expect_same_mean(caustic(), 2048, 8192)));
}

TEST(Guiding, CagedLampHasSameMeanAndLessNoise) {
  const double gain = expect_same_mean(caged_lamp(), 512, 16384);
  RecordProperty("gain", std::to_string(gain));
  EXPECT_GT(gain, 10);
}

TEST(Guiding, RoomWithWindowHasSameMean) {
  RecordProperty("gain", std::to_string(expect_same_mean(room_with_window(), 1024, 2048)));
}

/// Light sampling chooses the sun, which is below the ground.
TEST(Guiding, RoomUnderSkyWithSunHasSameMeanAndLessNoise) {
  Scene scene = closed_room(0.4f);
  std::vector<float> sky(64 * 32 * 3, 3.0f);
  for (std::size_t c = 0; c < 3; ++c) sky[(24 * 64 + 2) * 3 + c] = 20000;
  set_sky(&scene, 64, 32, sky);
  const double gain = expect_same_mean(scene, 512, 2048);
  RecordProperty("gain", std::to_string(gain));
  EXPECT_GT(gain, 1.2);  // like under a sky without a sun
}

TEST(Guiding, MixedMaterialsHaveSameMean) {
  RecordProperty("gain", std::to_string(expect_same_mean(mixed(), 1024, 4096)));
}

// Few photons enter the room, so the first rounds say little about the gain.
TEST(Guiding, ClosedRoomIsGuidedForAnySeed) {
  const Scene scene = closed_room();
  for (std::uint32_t seed = 0; seed < 4; ++seed) {
    auto plain = settings_for(4, false), guided = settings_for(4, true);
    plain.seed = guided.seed = seed;
    EXPECT_NE(bytes(render_picture(scene, plain)), bytes(render_picture(scene, guided))) << seed;
  }
}

// No light is scattered towards the floor, so there is nothing to guide to.
TEST(Guiding, WithoutIndirectLightKeepsEveryBit) {
  Scene scene = empty_scene();
  add_floor(&scene, lambert({0.6f, 0.6f, 0.6f}));
  add_lamp(&scene, 8, {-1, 2, -1}, 2);
  look_at(&scene, {0, 1.6, 5}, {0, -0.4, 0});
  EXPECT_EQ(bytes(render_picture(scene, settings_for(16, false))),
            bytes(render_picture(scene, settings_for(16, true))));
}

TEST(Guiding, ThreadsDoNotChangeAnyBit) {
  const auto settings = settings_for(16, true);
  for (const Scene& scene : {caustic(), mixed()}) {
    const auto one = render::FrameRenderer::create(scene, settings, 0, render::sequential());
    const auto four =
        render::FrameRenderer::create(scene, settings, 0, render::parallel_threads(4));
    ASSERT_TRUE(one.ok() && four.ok());
    const contract::PixelRect all{0, 0, settings.width, settings.height};
    EXPECT_TRUE((*one)->render(all, {0, 16}, 0, render::sequential()) ==
                (*four)->render(all, {0, 16}, 0, render::parallel_threads(4)));
  }
}

TEST(Guiding, PhotonsDependOnTheirNumberAlone) {
  const Scene scene = mixed();
  const render::ShadingScene shading(scene);
  const render::SceneAccel accel(scene, render::sequential());
  const render::LightSampler lights(scene, shading);
  const render::PhotonScene photons{scene, shading, accel, lights};
  const auto all = trace_photons(photons, {}, 0, 65536, render::parallel_threads(4));
  auto parts = trace_photons(photons, {}, 0, 30001, render::sequential());
  const auto rest = trace_photons(photons, {}, 30001, 35535, render::sequential());
  parts.insert(parts.end(), rest.begin(), rest.end());
  ASSERT_GT(all.size(), 1000u);
  ASSERT_EQ(all.size(), parts.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_EQ(all[i].position, parts[i].position);
    EXPECT_EQ(all[i].direction, parts[i].direction);
    EXPECT_EQ(all[i].flux, parts[i].flux);
  }
}

// Few paths bring a photon to a part of the floor; paths near those do more often.
TEST(Guiding, ChainsBringWantedPhotonsForAnyThreads) {
  const Scene scene = caustic();
  const render::ShadingScene shading(scene);
  const render::SceneAccel accel(scene, render::sequential());
  const render::LightSampler lights(scene, shading);
  const render::PhotonSource source(scene, shading, lights);
  const render::PhotonScene photons{scene, shading, accel, lights};
  std::vector<render::SurfacePlace> places;
  for (int i = 0; i < 400; ++i) {
    places.push_back(
        {{0.1f * static_cast<float>(i % 20), -1, 0.01f * static_cast<float>(i / 20)}, {0, 1, 0}});
  }
  const render::VisibleRegion region(places);
  render::PhotonStore store(region, 0);
  const render::ParallelFor one = render::sequential(), four = render::parallel_threads(4);
  store.add(trace_photons(photons, region, 0, 65536, one));
  const std::size_t independent = store.photons().size();
  const auto paths = store.wanted_paths();
  ASSERT_GT(paths.size(), 10u);
  const auto found = trace_chains({photons, source, region, one}, store, paths, 7, 65536);
  EXPECT_GT(found.size(), 3 * independent);
  for (const render::Photon& photon : found) {
    EXPECT_TRUE(store.wants(photon));
    EXPECT_TRUE(std::find(paths.begin(), paths.end(), photon.path) != paths.end());
  }
  const auto again = trace_chains({photons, source, region, four}, store, paths, 7, 65536);
  ASSERT_EQ(found.size(), again.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(found[i].position, again[i].position);
    EXPECT_EQ(found[i].direction, again[i].direction);
  }
  // Chains from the same path differ.
  const auto same = trace_chains({photons, source, region, one}, store, {paths[0]}, 7, 1024);
  std::set<float> places_x;
  for (const render::Photon& photon : same) places_x.insert(photon.position.x);
  EXPECT_GT(same.size(), 100u);
  EXPECT_GT(places_x.size(), 0.9 * static_cast<double>(same.size()));
}

}  // namespace
}  // namespace tessera::testing
