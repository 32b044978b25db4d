// Second paths towards lights out of focus change the noise of a picture, not its expected values.

#include "worker/render/spots/lens_spots.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "tests/support/scene/plain_scene.h"
#include "worker/render/camera/aperture.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/render/parallel_threads.h"
#include "worker/render/spots/searched_lights.h"

namespace tessera::testing {
namespace {

using render::AperturePoint;
using render::CameraRays;
using render::Lens;
using render::LensSpot;
using render::LensSpots;
using render::PixelFilterSampler;
using render::Scene;
using render::Vec2d;
using render::Vec2f;
using render::Vec3d;

constexpr std::int32_t kWidth = 32, kHeight = 24;

/// A point of [0, 1)^2 in the middle of a cell of a square grid.
Vec2f cell_middle(int i, int side) {
  return {(static_cast<float>(i % side) + 0.5f) / static_cast<float>(side),
          (static_cast<float>(i / side) + 0.5f) / static_cast<float>(side)};
}

std::vector<Lens> lenses() {
  Lens round, bladed;
  round.radius = bladed.radius = 0.2;
  round.focus_distance = bladed.focus_distance = 2;
  bladed.blades = 5;
  bladed.blade_rotation = 0.3;
  return {round, bladed};
}

TEST(Aperture, SamplesAreInsideAndFillItsArea) {
  constexpr int kSide = 300;
  for (const Lens& lens : lenses()) {
    Lens smaller = lens;
    smaller.radius *= 1 - 1e-6;  // float rounding of the samples
    int inside = 0;
    for (int i = 0; i < kSide * kSide; ++i) {
      const AperturePoint sample = render::aperture_point(smaller, cell_middle(i, kSide));
      ASSERT_TRUE(render::is_in_aperture(lens, sample)) << sample.x << " " << sample.y;
      const Vec2f u = cell_middle(i, kSide);
      inside += render::is_in_aperture(lens, {lens.radius * (2 * double{u.x} - 1),
                                              lens.radius * (2 * double{u.y} - 1)})
                    ? 1
                    : 0;
    }
    const double square = 4 * lens.radius * lens.radius;
    // Cells of the grid that the border cuts: about 4 x 300.
    EXPECT_NEAR(inside * square / (kSide * kSide), render::aperture_area(lens), 0.005 * square);
  }
}

/// Light that a sample finds through a point of the lens, for the test below.
double light_at(const AperturePoint& p) {
  return 1 + 3 * p.x + 20 * p.x * p.y;
}

// Second paths find the light that the weights take from first paths: of lights before and behind
// the plane of focus, of one that the edge of the lens cuts, and of one behind others.
TEST(LensSpots, WeightsOfBothPathsAddUp) {
  const PixelFilterSampler filter(contract::PixelFilter::gaussian, 3);
  for (const Lens& lens : lenses()) {
    render::Camera camera = empty_scene().camera;
    camera.yfov = 0.5;
    camera.lens = lens;
    const CameraRays rays(camera, kWidth, kHeight);
    const LensSpots spots({{{-0.03, -0.02, 5}, {0.05, 0.06, 5.1}, 10},
                           {{0.02, -0.01, 1}, {0.05, 0.03, 1.05}, 20},
                           {{0.2, 0.1, 5}, {0.3, 0.25, 5.2}, 10},
                           {{-0.1, -0.05, 6}, {0.1, 0.07, 6}, 1}},
                          rays, filter, kWidth, kHeight);
    const LensSpots::Pixel pixel = spots.at(16, 12);
    ASSERT_FALSE(pixel.empty());
    for (const Vec2d slope : {rays.slope_at(16.2, 12.3), rays.slope_at(18, 11.1)}) {
      constexpr int kSide = 800, kFewer = 150, kChoices = 100;
      double missing = 0, second = 0;
      for (int i = 0; i < kSide * kSide; ++i) {
        const AperturePoint p = render::aperture_point(lens, cell_middle(i, kSide));
        missing += light_at(p) * (1 - double{pixel.weight(p, slope)}) / (kSide * kSide);
      }
      for (int i = 0; i < kFewer * kFewer; ++i) {
        for (int k = 0; k < kChoices; ++k) {
          const auto found = pixel.sample((static_cast<float>(k) + 0.5f) / kChoices,
                                          cell_middle(i, kFewer), slope);
          second += light_at(found.point) * double{found.weight} / (kFewer * kFewer * kChoices);
        }
      }
      EXPECT_GT(missing, 0.02);
      // Cells at the border of a light, of which the smallest is 30 cells wide.
      EXPECT_NEAR(second / missing, 1, 0.05);
    }
  }
}

/// Small lamps before and behind balls in focus, seen through a wide lens.
Scene lamps_out_of_focus() {
  Scene scene = empty_scene();
  const auto paint = add_material(&scene, lambert({0.5f, 0.4f, 0.3f}));
  add_primitive(&scene, sphere({-0.7f, 0, 0}, 0.5f, 32, paint));
  add_primitive(&scene, sphere({0.8f, 0, -0.2f}, 0.5f, 32, paint));
  const auto light = add_material(&scene, lamp(200));
  add_primitive(&scene, sphere({0.1f, 0.3f, -4}, 0.03f, 12, light));
  add_primitive(&scene, quad({-1.3f, 0.8f, -4}, {0.06f, 0, 0}, {0, 0.06f, 0}, light));
  add_primitive(&scene, quad({0.5f, -0.3f, 2.4f}, {0.02f, 0, 0}, {0, 0.02f, 0.01f}, light));
  add_primitive(&scene, quad({-4, -4, -6}, {8, 0, 0}, {0, 8, 0}, paint));
  set_constant_sky(&scene, 0.1f);
  look_at(&scene, {0, 0.2f, 5}, {0, 0, 0});
  scene.camera.yfov = 0.5;
  scene.camera.lens.radius = 0.2;
  scene.camera.lens.focus_distance = 5;
  return scene;
}

std::vector<LensSpot> spots_in(const Scene& scene) {
  const render::ShadingScene shading(scene);
  const render::SceneAccel accel(scene, render::sequential());
  const render::LightSampler lights(scene, shading);
  const CameraRays camera(scene.camera, kWidth, kHeight);
  return render::find_lens_spots(camera, render::SpecularTracer(shading, accel, 6),
                                 render::searched_lights(scene, shading, lights));
}

TEST(LensSpotSearch, FindsVisibleLampsOutOfFocus) {
  EXPECT_EQ(spots_in(lamps_out_of_focus()).size(), 3u);
}

TEST(LensSpotSearch, OmitsHiddenLampsAndThoseInFocus) {
  Scene scene = lamps_out_of_focus();
  const auto light = add_material(&scene, lamp(200));
  add_primitive(&scene, quad({0, 0.9f, 0.2f}, {0.1f, 0, 0}, {0, 0.1f, -0.4f}, light));  // in focus
  add_primitive(&scene, quad({0, 0, 6}, {0.1f, 0, 0}, {0, 0.1f, 0}, light));  // behind the camera
  add_primitive(&scene, sphere({-0.7f, 0, -0.9f}, 0.05f, 12, light));         // behind a ball
  EXPECT_EQ(spots_in(scene).size(), 3u);
}

contract::RenderSettings settings_for(std::int32_t spp, bool guiding) {
  auto settings = small_settings(kWidth, kHeight, spp);
  settings.guiding = guiding;
  settings.max_depth = 4;
  return settings;
}

void expect_same_mean(const Scene& scene) {
  const Picture plain = render_picture(scene, settings_for(4096, false));
  const Picture guided = render_picture(scene, settings_for(1024, true));
  const double error = std::hypot(plain.mean_error(), guided.mean_error());
  EXPECT_LT(std::fabs(plain.mean() - guided.mean()), 4 * error);
  EXPECT_LT(largest_difference(plain, guided), 4.5);
}

TEST(LensSpots, PicturesHaveSameMean) {
  expect_same_mean(lamps_out_of_focus());
}

TEST(LensSpots, PicturesOfBladesAndRimHaveSameMean) {
  Scene scene = lamps_out_of_focus();
  scene.camera.lens.blades = 6;
  scene.camera.lens.rim_distance = 0.1;
  scene.camera.lens.rim_radius = 0.19;
  expect_same_mean(scene);
}

double noise(const Scene& scene, bool guiding) {
  return noise_between_seeds(scene, settings_for(64, guiding));
}

TEST(LensSpots, LampsOutOfFocusHaveLessNoise) {
  const Scene scene = lamps_out_of_focus();
  const double plain = noise(scene, false), guided = noise(scene, true);
  RecordProperty("gain", std::to_string(plain / guided));
  EXPECT_GT(plain / guided, 8);
}

}  // namespace
}  // namespace tessera::testing
