// Hard cases 55, 56 and 66: images as skies.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "tests/support/scene/plain_scene.h"
#include "worker/light/emitters/environment_map.h"

namespace tessera::testing {
namespace {

using render::Scene;
using render::Vec3d;
using render::Vec3f;

/// A white square about the origin that faces `up`, and a camera that sees a tiny spot of it.
Scene square_facing(const Vec3d& up) {
  Scene scene = empty_scene();
  const auto white = add_material(&scene, lambert({1, 1, 1}));
  const Vec3d side = normalize(cross(up, std::fabs(up.y) > 0.9 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0}));
  const Vec3f a(side * 9.0), b(cross(up, side) * 9.0);
  add_primitive(&scene, quad((a + b) * -0.5f, a, b, white));
  look_at(&scene, up * 4.0 + side * 0.3, {0, 0, 0});
  scene.camera.yfov = 1e-6;
  return scene;
}

/// Radiance of the square after one scattering, which is its irradiance over pi.
Picture scattered_once(const Scene& scene, int side, int spp) {
  auto settings = small_settings(side, side, spp);
  settings.max_depth = 1;
  return render_picture(scene, settings);
}

TEST(Sky, ConstantSkyLightsWhiteFloorEqually) {  // hard case 56
  Scene scene = square_facing({0, 1, 0});
  set_constant_sky(&scene, 2);
  EXPECT_NEAR(scattered_once(scene, 1, 16).at(0, 0).x, 2, 1e-6);
  // One texel below the floor keeps the image from counting as constant, so directions are drawn
  // from it: mostly towards that texel, and the rest by the BSDF.
  constexpr int kWidth = 64, kHeight = 32;
  std::vector<float> texels(kWidth * kHeight * 3, 1.0f);
  for (std::size_t c = 0; c < 3; ++c) texels[(30 * kWidth + 5) * 3 + c] = 2;
  set_sky(&scene, kWidth, kHeight, texels);
  ASSERT_FALSE(render::EnvironmentMap(scene).is_constant());
  const Picture picture = scattered_once(scene, 8, 4096);
  const double error = std::sqrt(3) * picture.mean_error();  // grey: its channels are one
  EXPECT_NEAR(picture.mean(), 1, 4 * error + 1e-6);
  EXPECT_LT(4 * error, 1e-4 / std::numbers::pi);
}

/// Irradiance over pi, for the normal (0, 1, 0) or for the mean over all normals (`flux`), from a
/// texel of radiance 1 on black: the integral of its bilinear tent. In the first row lookups clamp
/// to its centre, so the upper half of the tent is flat.
double texel_irradiance(int width, int height, int row, bool flux) {
  constexpr int kSub = 4000;
  double sum = 0;
  for (int k = 0; k < kSub; ++k) {
    const double y = -1 + 2 * (k + 0.5) / kSub, v = (row + 0.5 + y) / height * std::numbers::pi;
    if (v < 0) continue;
    const double weight = row == 0 && y < 0 ? 1 : 1 - std::fabs(y);
    sum += weight * (flux ? 0.25 : std::cos(v)) * std::sin(v) * (2.0 / kSub);
  }
  return sum * (std::numbers::pi / height) * (2 * std::numbers::pi / width) / std::numbers::pi;
}

TEST(Sky, BrightPoleTexelGivesItsFlux) {  // hard case 56
  constexpr int kWidth = 64, kHeight = 32;
  std::vector<float> texels(kWidth * kHeight * 3, 0.0f);
  for (std::size_t c = 0; c < 3; ++c) texels[7 * 3 + c] = 1e4f;
  Scene scene = square_facing({0, 1, 0});
  set_sky(&scene, kWidth, kHeight, texels);
  const double expected = 1e4 * texel_irradiance(kWidth, kHeight, 0, false);
  // The tent holds 13/12 of the texel's own solid angle, up to terms of the texel's height squared.
  const double own = 2 * std::numbers::pi / kWidth * (1 - std::cos(std::numbers::pi / kHeight));
  EXPECT_NEAR(4 * std::numbers::pi * texel_irradiance(kWidth, kHeight, 0, true) / own, 13.0 / 12,
              2e-3);
  const Picture picture = scattered_once(scene, 8, 1024);
  const double error = std::sqrt(3) * picture.mean_error();
  EXPECT_NEAR(picture.mean() / expected, 1, 4 * error / expected + 1e-6);
  EXPECT_LT(error / expected, 2.5e-4);
}

TEST(Sky, BrightTexelLightsPlane) {  // hard case 55
  constexpr int kWidth = 2048, kHeight = 1024, kRow = 300, kColumn = 520;
  std::vector<float> texels(std::size_t{kWidth} * kHeight * 3, 0.0f);
  const std::size_t at = (std::size_t{kRow} * kWidth + kColumn) * 3;
  for (std::size_t c = 0; c < 3; ++c) texels[at + c] = 1e6f;
  const double theta = (kRow + 0.5) / kHeight * std::numbers::pi;
  const double phi = 2 * std::numbers::pi * ((kColumn + 0.5) / kWidth - 0.5);
  const Vec3d towards = {std::sin(theta) * std::cos(phi), std::cos(theta),
                         std::sin(theta) * std::sin(phi)};
  for (const float rest : {0.0f, 1e-3f}) {  // the second made a float CDF lose most texels
    for (std::size_t i = 0; i < texels.size(); ++i) {
      if (i < at || i >= at + 3) texels[i] = rest;
    }
    Scene floor = square_facing({0, 1, 0}), facing = square_facing(towards);
    set_sky(&floor, kWidth, kHeight, texels);
    set_sky(&facing, kWidth, kHeight, texels);
    EXPECT_NEAR(scattered_once(floor, 1, 256).at(0, 0).x / (1.44253 + rest), 1, 1e-3);
    EXPECT_NEAR(scattered_once(facing, 1, 256).at(0, 0).x / (2.38715 + rest), 1, 1e-3);
  }
}

TEST(Sky, TexelAppearsInPredictedDirection) {
  constexpr int kWidth = 64, kHeight = 32;
  for (const double degrees : {0.0, 90.0, 37.5}) {
    for (const Vec3d& d : {Vec3d{1, 0.2, 0.1}, Vec3d{-0.3, -0.8, -1}, Vec3d{0.1, 1, 2}}) {
      const Vec3d dir = normalize(d);
      double u = 0.5 + std::atan2(dir.z, dir.x) / (2 * std::numbers::pi) + degrees / 360;
      u -= std::floor(u);
      const double v = std::acos(dir.y) / std::numbers::pi;
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
  double sampled = 0, left = 0, density = 0;
  constexpr int kSide = 300, kSphere = 400'000;
  for (int i = 0; i < kSide * kSide; ++i) {
    const int row = i / kSide, column = i % kSide;
    const auto s = map.sample((row + 0.5) / kSide, (column + 0.5) / kSide);
    ASSERT_NEAR(static_cast<double>(length(s.direction)), 1, 1e-6);
    ASSERT_NEAR(static_cast<double>(map.pdf(s.direction) / s.pdf), 1, 1e-5);
    sampled += static_cast<double>(luminance(s.radiance) / s.pdf) / (kSide * kSide);
  }
  for (int i = 0; i < kSphere; ++i) {
    const auto found = map.look_up(spread(i, kSphere));
    density += static_cast<double>(found.pdf) * 4 * std::numbers::pi / kSphere;
    if (!(found.pdf > 0)) left += luminance(found.radiance) * 4 * std::numbers::pi / kSphere;
  }
  EXPECT_NEAR(density, 1, 2e-3);
  // Light samples find directions with density, BSDF samples those without; together they find all.
  EXPECT_NEAR((sampled + left) / map.power(), 1, 1e-2);
  EXPECT_GT(left, 0.01 * map.power());
}

TEST(Environment, UnsampledPartIsItsShareOfThePower) {
  std::vector<float> texels(32 * 16 * 3);
  for (std::size_t i = 0; i < texels.size(); ++i) texels[i] = static_cast<float>(i / (32 * 3));
  texels[200 * 3] = 1000;  // a red sun in a sky that gets brighter downwards
  Scene scene;
  set_sky(&scene, 32, 16, texels);
  scene.environment.strength = 2.5;
  const render::EnvironmentMap map(scene);
  constexpr int kSphere = 400'000;
  double whole = 0, unsampled = 0;
  for (int i = 0; i < kSphere; ++i) {
    const Vec3f radiance = map.radiance(spread(i, kSphere)), part = map.unsampled(radiance);
    ASSERT_LE(part.x, radiance.x);
    whole += luminance(radiance);
    unsampled += luminance(part);
  }
  // Around the sun the filtered radiance exceeds the mean by less than the texels do.
  EXPECT_NEAR(unsampled / whole, map.unsampled_share(), 0.02);
  EXPECT_GT(map.unsampled_share(), 0.5);
  EXPECT_LT(map.unsampled_share(), 0.9);
}

/// Excess of the texels' luminance over the mean of the sphere, as rows of `width`.
std::vector<double> excesses(const std::vector<float>& texels, int width, int height) {
  double mean = 0;
  for (int j = 0; j < height; ++j) {
    const double share =
        (std::cos(std::numbers::pi * j / height) - std::cos(std::numbers::pi * (j + 1) / height)) /
        2;
    for (int i = 0; i < width; ++i) {
      mean +=
          static_cast<double>(texels[static_cast<std::size_t>(j * width + i) * 3]) * share / width;
    }
  }
  std::vector<double> all;
  for (std::size_t i = 0; i < texels.size(); i += 3) {
    all.push_back(std::max(static_cast<double>(texels[i]) - mean, 0.0));
  }
  return all;
}

TEST(Environment, SamplesPassChiSquareTest) {  // hard case 55
  constexpr int kWidth = 48, kHeight = 24, kSamples = 1'000'000;
  std::mt19937 random(17);
  std::vector<float> texels(kWidth * kHeight * 3);
  for (std::size_t i = 0; i < texels.size(); i += 3) {
    const float grey = random() % 3 == 0 ? 0.0f : static_cast<float>(random() % 1000);
    for (std::size_t c = 0; c < 3; ++c) texels[i + c] = i == 0 ? 20'000 : grey;
  }
  Scene scene;
  set_sky(&scene, kWidth, kHeight, texels);
  const render::EnvironmentMap map(scene);
  std::vector<double> count(kWidth * kHeight, 0);
  for (int k = 0; k < kSamples; ++k) {
    const double u1 = static_cast<double>(random()) * 0x1p-32;
    const Vec3d d(map.sample(u1, static_cast<double>(random()) * 0x1p-32).direction);
    const double u = 0.5 + std::atan2(d.z, d.x) / (2 * std::numbers::pi);
    const double v = std::atan2(std::hypot(d.x, d.z), d.y) / std::numbers::pi;
    const int i = std::min(static_cast<int>(u * kWidth), kWidth - 1);
    ++count[static_cast<std::size_t>(std::min(static_cast<int>(v * kHeight), kHeight - 1) * kWidth +
                                     i)];
  }
  // Bilinear weights of a texel's neighbours, integrated over its square: 1/8, 6/8, 1/8 per axis.
  const std::vector<double> excess = excesses(texels, kWidth, kHeight);
  const auto weight = [&](int i, int j) {
    const int row = std::clamp(j, 0, kHeight - 1);
    return excess[static_cast<std::size_t>(row * kWidth + (i + kWidth) % kWidth)] *
           std::sin(std::numbers::pi * (row + 0.5) / kHeight);
  };
  double total = 0, chi2 = 0;
  for (int j = 0; j < kHeight; ++j) {
    for (int i = 0; i < kWidth; ++i) total += weight(i, j);
  }
  constexpr std::array<double, 3> kShares = {0.125, 0.75, 0.125};
  int cells = 0;
  for (int j = 0; j < kHeight; ++j) {
    for (int i = 0; i < kWidth; ++i) {
      double expected = 0;
      for (int dj = -1; dj <= 1; ++dj) {
        for (int di = -1; di <= 1; ++di) {
          expected += kShares[static_cast<std::size_t>(dj + 1)] *
                      kShares[static_cast<std::size_t>(di + 1)] * weight(i + di, j + dj) / total;
        }
      }
      expected *= kSamples;
      const double found = count[static_cast<std::size_t>(j * kWidth + i)];
      if (!(expected > 0)) {
        EXPECT_EQ(found, 0) << i << " " << j;
      }
      if (!(expected >= 5)) continue;
      chi2 += (found - expected) * (found - expected) / expected;
      ++cells;
    }
  }
  EXPECT_GT(cells, 900);
  // Wilson and Hilferty's approximation of the quantile that is exceeded once in a hundred times.
  const double n = cells - 1;
  EXPECT_LT(chi2, n * std::pow(1 - 2 / (9 * n) + 2.326 * std::sqrt(2 / (9 * n)), 3));
}

TEST(Environment, BrightTexelsAreSampled) {  // hard case 66
  std::vector<float> texels(16 * 8 * 3, 0.0f);
  texels[(3 * 16 + 0) * 3] = 1e-6f;  // its filter wraps around the seam
  Scene scene;
  set_sky(&scene, 16, 8, texels);
  const render::EnvironmentMap map(scene);
  const double mean = map.power() / (4 * std::numbers::pi);
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
