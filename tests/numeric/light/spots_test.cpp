// Second paths towards images of lights change the noise of a picture, not its expected values.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "tests/support/scene/plain_scene.h"
#include "worker/light/emitters/environment_map.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/render/parallel_threads.h"
#include "worker/render/spots/convex_polygon.h"
#include "worker/render/spots/light_spots.h"
#include "worker/render/spots/searched_lights.h"
#include "worker/render/spots/specular_segments.h"
#include "worker/render/spots/spot_search.h"

namespace tessera::testing {
namespace {

using render::DeltaLobe;
using render::LightSpot;
using render::LightSpots;
using render::Material;
using render::PixelFilterSampler;
using render::Scene;
using render::Vec2d;
using render::Vec2f;
using render::Vec3d;
using render::Vec3f;

constexpr std::int32_t kWidth = 32, kHeight = 24;

/// The number of one delta lobe, and of two.
std::uint64_t lobes_of(DeltaLobe first) {
  return render::with_lobe(render::kNoLobes, first);
}
std::uint64_t lobes_of(DeltaLobe first, DeltaLobe second) {
  return render::with_lobe(lobes_of(first), second);
}

TEST(DeltaLobes, AreFollowedInOrder) {
  const std::uint64_t all = lobes_of(DeltaLobe::refraction, DeltaLobe::coat);
  EXPECT_EQ(render::next_lobe(render::kNoLobes, all), DeltaLobe::refraction);
  EXPECT_EQ(render::next_lobe(lobes_of(DeltaLobe::refraction), all), DeltaLobe::coat);
  EXPECT_EQ(render::next_lobe(all, all), std::nullopt);
  std::uint64_t many = render::kNoLobes;
  for (int i = 0; i < 31; ++i) many = render::with_lobe(many, DeltaLobe::reflection);
  EXPECT_NE(many, 0u);
  EXPECT_EQ(render::with_lobe(many, DeltaLobe::reflection), 0u);
}

TEST(PixelFilter, DensityIsThatOfSamples) {
  for (const auto kind : {contract::PixelFilter::box, contract::PixelFilter::gaussian,
                          contract::PixelFilter::blackman_harris}) {
    const PixelFilterSampler filter(kind, 3);
    constexpr int kSide = 1024;
    const auto peak = std::sqrt(static_cast<double>(filter.density(Vec2f{0, 0})));
    const auto quantile = [&](int i) {
      return static_cast<double>(filter.sample({static_cast<float>(i) / kSide, 0.5f}).x);
    };
    // The middle half of the samples; the tables' steps are 1 / 1024 of the width.
    for (int i = kSide / 4; i < kSide * 3 / 4; i += 32) {
      const double middle = 0.5 * (quantile(i) + quantile(i + 32));
      const double density =
          static_cast<double>(filter.density(Vec2f{static_cast<float>(middle), 0})) / peak;
      EXPECT_NEAR(32.0 / kSide / (quantile(i + 32) - quantile(i)), density, 0.01 * density);
    }
    // The integral of the density.
    double sum = 0;
    for (int i = 0; i < 3 * kSide; ++i) {
      const float x = (static_cast<float>(i) + 0.5f) / kSide - 1.5f;
      sum += static_cast<double>(filter.density(Vec2f{x, 0})) / kSide;
    }
    EXPECT_NEAR(sum, peak, 1e-4 * peak);
    EXPECT_EQ(filter.density(Vec2f{1.6f, 0}), 0);
  }
}

TEST(ConvexPolygon, HullHasNoInnerPoints) {
  const std::vector<Vec2d> hull = render::convex_hull(
      {{1, 1}, {0, 0}, {2, 0}, {1, 0}, {2, 2}, {0.5, 1.5}, {0, 2}, {0, 1}, {2, 2}});
  EXPECT_EQ(hull.size(), 4u);
  EXPECT_EQ(render::area_of(hull), 4);
  EXPECT_EQ(render::centre_of(hull).x, 1);
  EXPECT_LT(render::convex_hull({{0, 0}, {1, 1}, {2, 2}}).size(), 3u);
  EXPECT_TRUE(render::convex_hull({}).empty());
}

TEST(ConvexPolygon, IsCutAtSquare) {
  const std::vector<Vec2d> triangle = {{-2, -2}, {2, -2}, {-2, 2}};
  // A square with sides of 2.5 without a corner, a triangle with two sides of 2.
  const std::vector<Vec2d> part = render::part_in_square(triangle, -1.5, 1);
  EXPECT_EQ(part.size(), 5u);
  EXPECT_DOUBLE_EQ(render::area_of(part), 4.25);
  EXPECT_TRUE(render::part_in_square(triangle, 1.5, 2).empty());
}

// Two thirds of the points are inside, and as many in each part of it as the density says.
TEST(AroundPolygon, SamplesHaveTheirDensity) {
  const std::vector<Vec2d> polygon = {{0, 0}, {3, 0.5}, {2.5, 2}, {0.5, 1}};
  const render::AroundPolygon around(polygon, render::centre_of(polygon), render::area_of(polygon));
  constexpr int kSide = 960, kBins = 24;
  std::vector<double> samples(kBins * kBins), expected(kBins * kBins);
  const auto bin = [](double v) { return static_cast<int>(std::floor((v + 2.5) * 3)); };
  for (int i = 0; i < kSide * kSide; ++i) {
    const float u = (static_cast<float>(i % kSide) + 0.5f) / kSide;
    const float v = (static_cast<float>(i / kSide) + 0.5f) / kSide;
    const Vec2f p = around.sample({u, v});
    const int x = bin(double{p.x}), y = bin(double{p.y});
    if (std::min(x, y) >= 0 && std::max(x, y) < kBins)
      samples[static_cast<std::size_t>(y * kBins + x)] += 1.0 / (kSide * kSide);
    const Vec2f at{8 * u - 2.5f, 8 * v - 2.5f};
    expected[static_cast<std::size_t>(bin(double{at.y}) * kBins + bin(double{at.x}))] +=
        64 * around.density(at) / (kSide * kSide);
  }
  double all = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    EXPECT_NEAR(samples[i], expected[i], 0.02 * expected[i] + 1e-4) << i;
    all += expected[i];
  }
  EXPECT_GT(all, 0.9);  // the others are further away
}

/// Light that a sample finds at an offset, for the test below.
double light_at(const Vec2f& p) {
  return 1 + 0.3 * static_cast<double>(p.x) + 0.2 * static_cast<double>(p.x * p.y);
}

// The two paths of a sample together find the light of each way once.
TEST(LightSpots, WeightsOfBothPathsAddUp) {
  const PixelFilterSampler filter(contract::PixelFilter::gaussian, 3);
  const std::uint64_t mirror = lobes_of(DeltaLobe::reflection);
  const std::uint64_t lens = lobes_of(DeltaLobe::refraction, DeltaLobe::refraction);
  const std::vector<Vec2d> small = {{10.6, 8.1}, {10.8, 8}, {10.8, 8.4}, {10.7, 8.4}};
  const std::vector<Vec2d> other = {{10.1, 8.8}, {10.7, 8.8}, {10.3, 9}};
  const std::vector<Vec2d> edge = {{11.8, 0}, {31, 4}, {30, 20}, {11.7, 20}};
  const std::vector<Vec2d> wide = {{5, 0}, {20, 3}, {18, 20}, {7, 19}};
  const LightSpots spots({{small, mirror, 100, 1},
                          {other, mirror, 50, 0.25f},
                          {edge, mirror, 4, 1},
                          {wide, lens, 2, 0.05f}},
                         filter, kWidth, kHeight);
  const LightSpots::Pixel pixel = spots.at(10, 8);
  ASSERT_FALSE(pixel.empty());
  constexpr int kSide = 400, kChoices = 60;
  for (const std::uint64_t lobes : {mirror, lens}) {
    double first = 0, whole = 0, second = 0;
    for (int i = 0; i < kSide * kSide; ++i) {
      const Vec2f u{(static_cast<float>(i % kSide) + 0.5f) / kSide,
                    (static_cast<float>(i / kSide) + 0.5f) / kSide};
      const Vec2f p = filter.sample(u);
      whole += light_at(p);
      first += light_at(p) * static_cast<double>(pixel.weight(p, lobes));
      for (int k = 0; k < kChoices; ++k) {
        const auto found = pixel.sample((static_cast<float>(k) + 0.5f) / kChoices, u);
        if (found.lobes != lobes) continue;
        second += light_at(found.offset) * static_cast<double>(found.weight) / kChoices;
      }
    }
    EXPECT_LT(first, whole);
    EXPECT_GT(second, 0);
    // Error of the choices: the shares of the spots are met to 1 / 120.
    EXPECT_NEAR((first + second) / whole, 1, 0.02) << lobes;
  }
  EXPECT_EQ(pixel.weight({0, 0}, lobes_of(DeltaLobe::coat)), 1);
  EXPECT_TRUE(spots.at(2, 8).empty());
}

// A black spot of a mirror's texture may show the centre of a lamp.
TEST(LightSpots, DarkSpotsDoNotCount) {
  const PixelFilterSampler filter(contract::PixelFilter::box, 1);
  const std::vector<Vec2d> outline = {{10.6, 8.1}, {10.8, 8.1}, {10.8, 8.4}};
  EXPECT_FALSE(LightSpots({{outline, render::kNoLobes, 1, 1}}, filter, kWidth, kHeight).empty());
  EXPECT_TRUE(LightSpots({{outline, render::kNoLobes, 0, 1}}, filter, kWidth, kHeight).empty());
}

/// The images of lights that the search finds in a scene.
std::vector<LightSpot> spots_in(const Scene& scene) {
  const render::ShadingScene shading(scene);
  const render::SceneAccel accel(scene, render::sequential());
  const render::LightSampler lights(scene, shading);
  const render::CameraRays camera(scene.camera, kWidth, kHeight);
  render::SpotSearch search{shading, accel, camera};
  search.width = kWidth;
  search.height = kHeight;
  search.margin = 1.5;
  return find_spots(search, render::searched_lights(scene, shading, lights), render::sequential());
}

/// A square lamp that faces down, and its mirror image in the plane y = 0.
constexpr Vec3f kCorner{0.3f, 1.5f, -0.6f};
constexpr float kSide = 0.02f;

Scene flat_mirror(const Material& material) {
  Scene scene = empty_scene();
  add_primitive(&scene, quad({-3, 0, 3}, {6, 0, 0}, {0, 0, -6}, add_material(&scene, material)));
  add_primitive(&scene,
                quad(kCorner, {kSide, 0, 0}, {0, 0, kSide}, add_material(&scene, lamp(100))));
  look_at(&scene, {0, 1.2, 4}, {0, -0.3, 0});
  return scene;
}

TEST(SpotSearch, FindsImageInFlatMirror) {
  const Scene scene = flat_mirror(metal(0));
  const render::CameraRays camera(scene.camera, kWidth, kHeight);
  const auto image = [&](float s, float t) {
    const Vec3d p{double{kCorner.x + s * kSide}, -double{kCorner.y}, double{kCorner.z + t * kSide}};
    return *camera.project(p);
  };
  const auto centre = image(0.5f, 0.5f), corner = image(0, 0), right = image(1, 0),
             down = image(0, 1);
  const double area = std::fabs((right.x - corner.x) * (down.y - corner.y) -
                                (right.y - corner.y) * (down.x - corner.x));
  int found = 0;
  for (const LightSpot& spot : spots_in(scene)) {
    if (spot.lobes != lobes_of(DeltaLobe::reflection)) continue;
    ++found;
    EXPECT_NEAR(render::centre_of(spot.outline).x, centre.x, 1e-3);
    EXPECT_NEAR(render::centre_of(spot.outline).y, centre.y, 1e-3);
    EXPECT_NEAR(spot.area() / area, 1, 0.01);
    EXPECT_NEAR(spot.brightness, 100, 1e-3);
    EXPECT_EQ(spot.probability, 1);
  }
  EXPECT_EQ(found, 1);
}

// The lamp seen directly is a spot too; from the other side it is dark.
TEST(SpotSearch, FindsLampItselfFromItsBrightSide) {
  Scene scene = flat_mirror(lambert({0.5f, 0.5f, 0.5f}));
  look_at(&scene, {0, 0.2, 4}, {0, 1, 0});
  ASSERT_EQ(spots_in(scene).size(), 1u);
  EXPECT_EQ(spots_in(scene)[0].lobes, render::kNoLobes);
  look_at(&scene, {0, 3, 4}, {0, 1, 0});
  EXPECT_TRUE(spots_in(scene).empty());
}

TEST(SpotSearch, OmitsHiddenImages) {
  Scene scene = flat_mirror(metal(0));
  add_primitive(&scene, box({0.2f, 1.3f, -0.8f}, {0.5f, 1.4f, -0.4f}, false,
                            add_material(&scene, lambert({0, 0, 0}))));
  EXPECT_TRUE(spots_in(scene).empty());
}

// A ball of triangles has the outline of a disk, wherever its vertices are.
TEST(SpotSearch, OutlinesBall) {
  Scene scene = empty_scene();
  add_primitive(&scene, sphere({0, 0, 0}, 1, 64, add_material(&scene, lamp(1))));
  look_at(&scene, {0, 0, 9}, {0, 0, 0});
  const auto spots = spots_in(scene);
  ASSERT_EQ(spots.size(), 1u);
  const auto limb = render::CameraRays(scene.camera, kWidth, kHeight)
                        .project({std::sqrt(80.0) / 9, 0, 1.0 / 9});  // where rays touch the ball
  const double radius = limb->x - kWidth * 0.5;
  EXPECT_LT(spots[0].area(), std::numbers::pi * radius * radius);
  EXPECT_GT(spots[0].area(), 0.9 * std::numbers::pi * radius * radius);
}

// The near edge of a tilted lamp looks much longer than the far one.
TEST(SpotSearch, OutlineHasCornersOfTiltedLamp) {
  const Vec3f corner{-1, -0.5f, 2}, right{2, 0, 0}, up{0, 1, -4};
  Scene scene = empty_scene();
  add_primitive(&scene, quad(corner, right, up, add_material(&scene, lamp(10))));
  look_at(&scene, {0, 1, 5}, {0, 0, 0});
  const auto spots = spots_in(scene);
  ASSERT_EQ(spots.size(), 1u);
  const render::CameraRays camera(scene.camera, kWidth, kHeight);
  for (const Vec3f& p : {corner, corner + right, corner + up, corner + right + up}) {
    const auto at = camera.project(Vec3d(p));
    double nearest = 1e9;
    for (const Vec2d& v : spots[0].outline)
      nearest = std::min(nearest, std::hypot(v.x - at->x, v.y - at->y));
    EXPECT_LT(nearest, 1e-3);
  }
}

// A lamp may reach into the picture although its centre is outside.
TEST(SpotSearch, FindsLampWithCentreOutside) {
  Scene scene = empty_scene();
  add_primitive(&scene, quad({0.5f, -1, 0}, {40, 0, 0}, {0, 2, 0}, add_material(&scene, lamp(10))));
  look_at(&scene, {0, 0, 4}, {0, 0, 0});
  ASSERT_EQ(spots_in(scene).size(), 1u);
  EXPECT_GT(render::centre_of(spots_in(scene)[0].outline).x, 2 * kWidth);
}

// Paths of a ball of glass that few samples choose: reflections at its outside and inside.
TEST(SpotSearch, FindsImagesOfBall) {
  Scene scene = empty_scene();
  add_primitive(&scene, sphere({0, 0, 0}, 0.8f, 48, add_material(&scene, glass(1.5f))));
  add_primitive(
      &scene, quad({-0.5f, 2, 0.5f}, {0.1f, 0, 0}, {0, 0, 0.1f}, add_material(&scene, lamp(100))));
  look_at(&scene, {0, 1, 4}, {0, 0, 0});
  int outside = 0, inside = 0;
  for (const LightSpot& spot : spots_in(scene)) {
    std::uint64_t within = lobes_of(DeltaLobe::refraction, DeltaLobe::reflection);
    within = render::with_lobe(within, DeltaLobe::reflection);
    within = render::with_lobe(within, DeltaLobe::refraction);
    outside += spot.lobes == lobes_of(DeltaLobe::reflection) ? 1 : 0;
    inside += spot.lobes == within ? 1 : 0;
  }
  EXPECT_EQ(outside, 1);
  EXPECT_GE(inside, 1);
}

TEST(EnvironmentSun, IsFoundWhereBrightAndSmall) {
  constexpr std::int32_t kColumns = 256, kRows = 128;
  Scene scene = empty_scene();
  std::vector<float> sky(kColumns * kRows * 3, 1);
  const auto light = [&](int x, int y, float radiance) {
    for (std::size_t c = 0; c < 3; ++c)
      sky[static_cast<std::size_t>(y * kColumns + x) * 3 + c] = radiance;
  };
  set_sky(&scene, kColumns, kRows, sky);
  EXPECT_FALSE(render::EnvironmentMap(scene).sun());
  for (const int x : {0, 255}) {  // across the seam of the map
    light(x, 40, 5000);
    light(x, 41, 5000);
  }
  set_sky(&scene, kColumns, kRows, sky);
  const auto sun = render::EnvironmentMap(scene).sun();
  ASSERT_TRUE(sun);
  const double polar = std::numbers::pi * 41 / kRows;  // the seam is at -x
  EXPECT_NEAR(sun->towards.x, -std::sin(polar), 1e-4);
  EXPECT_NEAR(sun->towards.y, std::cos(polar), 1e-4);
  EXPECT_NEAR(sun->towards.z, 0, 1e-9);
  EXPECT_NEAR(sun->radiance, 5000, 1);
  const double texel = std::numbers::pi / kRows;
  EXPECT_NEAR(sun->radius, std::sqrt(4 * std::sin(polar) / std::numbers::pi) * texel, 1e-3 * texel);
  // Two texels and two tents: (1/4 + 1/6) of a texel's square.
  EXPECT_NEAR(sun->covariance[1].y, (0.25 + 1.0 / 6) * texel * texel, 0.1 * texel * texel);
  for (int x = 100; x < 130; ++x) light(x, 60, 6000);
  set_sky(&scene, kColumns, kRows, sky);
  EXPECT_FALSE(render::EnvironmentMap(scene).sun());
}

/// Balls of metal and glass under a small lamp, in a dim sky.
Scene balls(float side) {
  Scene scene = empty_scene();
  const auto chrome = add_material(&scene, metal(0));
  add_primitive(&scene, sphere({-0.9f, 0, 0}, 0.6f, 32, chrome));
  add_primitive(&scene, sphere({0.4f, 0, -0.2f}, 0.6f, 32, chrome));
  add_primitive(&scene, sphere({1.2f, -0.2f, 0.9f}, 0.4f, 32, add_material(&scene, glass(1.5f))));
  add_primitive(&scene, quad({0, 2, 0}, {side, 0, 0}, {0, 0, side},
                             add_material(&scene, lamp(4 / (side * side)))));
  set_constant_sky(&scene, 0.25f);
  look_at(&scene, {0, 1, 5}, {0, 0, 0});
  return scene;
}

/// Adds a coated floor below the balls.
Scene with_floor(Scene scene) {
  Material floor = lambert({0.4f, 0.4f, 0.4f});
  floor.clearcoat.factor = 1;
  add_primitive(&scene, quad({-3, -0.6f, 3}, {6, 0, 0}, {0, 0, -6}, add_material(&scene, floor)));
  return scene;
}

contract::RenderSettings settings_for(std::int32_t spp, bool guiding) {
  auto settings = small_settings(kWidth, kHeight, spp);
  settings.guiding = guiding;
  settings.max_depth = 6;
  return settings;
}

void expect_same_mean(const Scene& scene, std::int32_t plain_spp, std::int32_t guided_spp) {
  ASSERT_FALSE(spots_in(scene).empty());
  const Picture plain = render_picture(scene, settings_for(plain_spp, false));
  const Picture guided = render_picture(scene, settings_for(guided_spp, true));
  const double error = std::hypot(plain.mean_error(), guided.mean_error());
  EXPECT_LT(std::fabs(plain.mean() - guided.mean()), 4 * error);
  EXPECT_LT(largest_difference(plain, guided), 4.5);
}

TEST(LightSpots, PicturesHaveSameMean) {
  expect_same_mean(with_floor(balls(0.25f)), 8192, 2048);
}

/// A room with polished walls, which mirror a lamp to the camera and light to each other.
Scene polished_room() {
  Scene scene = empty_scene();
  Material paint = lambert({0.6f, 0.6f, 0.6f});
  paint.specular = 1;
  paint.roughness = 0;
  paint.ior = 2;
  const auto polished = add_material(&scene, paint);
  add_primitive(&scene, box({-1, -1, -1}, {1, 1, 3}, true, polished));
  add_primitive(&scene,
                quad({-0.5f, 0.99f, -0.7f}, {1, 0, 0}, {0, 0, 1}, add_material(&scene, lamp(4))));
  look_at(&scene, {0, 0, 2.5}, {0, -0.2, 0});
  return scene;
}

// Light that mirrors show to diffuse surfaces is none of the second paths.
TEST(LightSpots, LightOfMirrorsOnDiffuseSurfacesStays) {
  expect_same_mean(polished_room(), 4096, 4096);
}

double noise(const Scene& scene, bool guiding) {
  return noise_between_seeds(scene, settings_for(64, guiding));
}

TEST(LightSpots, SmallLampInMirrorsHasLessNoise) {
  Scene scene = balls(0.02f);
  scene.camera.yfov = 0.25;  // balls only
  const double plain = noise(scene, false), guided = noise(scene, true);
  RecordProperty("gain", std::to_string(plain / guided));
  EXPECT_GT(plain / guided, 4);
}

/// A lamp that covers a thousandth of each pixel along its edges.
Scene lamp_at_pixel_edges() {
  Scene scene = empty_scene();
  add_primitive(&scene,
                quad({-0.5f, -0.5f, 0}, {1, 0, 0}, {0, 1, 0}, add_material(&scene, lamp(1000))));
  set_constant_sky(&scene, 1);
  look_at(&scene, {0, 0, 1}, {0, 0, 0});
  scene.camera.yfov = 2 * std::atan(0.5 * kHeight / (kHeight - 2 + 0.002));
  return scene;
}

TEST(LightSpots, EdgesOfLampHaveLessNoise) {
  const Scene scene = lamp_at_pixel_edges();
  const double plain = noise(scene, false), guided = noise(scene, true);
  RecordProperty("gain", std::to_string(plain / guided));
  EXPECT_GT(plain / guided, 50);
}

// The lamp covers the outer half pixel of a filter that is three pixels wide, where it is low.
TEST(LightSpots, EdgesInWideFilterCount) {
  const PixelFilterSampler filter(contract::PixelFilter::blackman_harris, 3);
  const std::vector<Vec2d> lamp = {{11.5, -20}, {60, -20}, {60, 50}, {11.5, 50}};
  const LightSpots spots({{lamp, render::kNoLobes, 1000, 1}}, filter, kWidth, kHeight);
  const LightSpots::Pixel pixel = spots.at(10, 8);
  ASSERT_FALSE(pixel.empty());
  int inside = 0;
  for (int i = 0; i < 900; ++i) {
    const Vec2f u{(static_cast<float>(i % 30) + 0.5f) / 30,
                  (static_cast<float>(i / 30) + 0.5f) / 30};
    inside += pixel.sample(0, u).offset.x > 1 ? 1 : 0;
  }
  EXPECT_GE(inside, 600);  // of the filter's own samples hardly any
  EXPECT_TRUE(spots.at(16, 8).empty());
}

TEST(LightSpots, SunInMirrorsHasLessNoise) {
  constexpr std::int32_t kColumns = 256, kRows = 128;
  Scene scene = empty_scene();
  add_primitive(&scene, sphere({0, 0, 0}, 1, 48, add_material(&scene, metal(0))));
  std::vector<float> sky(kColumns * kRows * 3, 1);
  for (std::size_t c = 0; c < 3; ++c) sky[(40 * kColumns + 170) * 3 + c] = 20000;
  set_sky(&scene, kColumns, kRows, sky);
  look_at(&scene, {0, 0, 8}, {0, 0, 0});
  const double plain = noise(scene, false), guided = noise(scene, true);
  RecordProperty("gain", std::to_string(plain / guided));
  EXPECT_GT(plain / guided, 4);
}

}  // namespace
}  // namespace tessera::testing
