/// TESSERA_texture: values of its patterns, filtering with distance, and use on surfaces.
#include "worker/shading/texture/procedural_texture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/support/scene/plain_scene.h"
#include "worker/sampling/gradient_noise.h"
#include "worker/sampling/hash.h"
#include "worker/sampling/value_noise.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::testing {
namespace {

using render::gradient_noise;
using render::Material;
using render::ProceduralTexture;
using render::Scene;
using render::value_noise;
using render::Vec3d;
using render::Vec3f;
using render::Vec4f;
using Pattern = ProceduralTexture::Pattern;

ProceduralTexture procedural(Pattern pattern) {
  ProceduralTexture f;
  f.pattern = pattern;
  f.ramp = {{0, {0, 0, 0, 1}}, {1, {1, 1, 1, 1}}};
  return f;
}

std::array<double, 4> point(int i) {
  std::array<double, 4> p;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::uint64_t bits = render::mix(static_cast<std::uint64_t>(4 * i) + k + 1);
    p[k] = static_cast<double>(bits >> 11) * 0x1p-53 * 1000 - 500;
  }
  return p;
}

/// Octave i of `f` at p.
double octave(const ProceduralTexture& f, std::array<double, 4> p, int i) {
  for (double& x : p) x *= std::pow(double{f.lacunarity}, i);
  return gradient_noise(f.dimensions, p, f.seed + static_cast<std::uint32_t>(i));
}

/// Sum of the octaves' noise, or of its absolute value, at p over the sum of their amplitudes.
double octave_mean(const ProceduralTexture& f, const std::array<double, 4>& p, int octaves,
                   bool absolute) {
  double sum = 0, amplitude_sum = 0;
  for (int k = 0; k < octaves; ++k) {
    const double n = octave(f, p, k), amplitude = std::pow(double{f.gain}, k);
    sum += amplitude * (absolute ? std::fabs(n) : n);
    amplitude_sum += amplitude;
  }
  return sum / amplitude_sum;
}

TEST(ProceduralTexture, OctaveSumMatchesFormula) {
  for (int i = 0; i < 1000; ++i) {
    ProceduralTexture f = procedural(Pattern::fbm);
    f.dimensions = 1 + i % 4;
    f.seed = 7;
    f.octaves = 1 + i % 5;
    f.lacunarity = 2.5f;
    f.gain = 0.4f;
    f.distortion = 0.7f;
    const auto p = point(i);
    double amplitude_sum = 0, ridges = 0, weight = 1;
    for (int k = 0; k < f.octaves; ++k) {
      const double n = octave(f, p, k), amplitude = std::pow(double{f.gain}, k);
      amplitude_sum += amplitude;
      const double signal = weight * (1 - std::fabs(n)) * (1 - std::fabs(n));
      ridges += amplitude * signal;
      weight = std::min(2 * signal, 1.0);
    }
    // A few float operations: 1e-6. The sine multiplies the error by 2 pi and by the distortion.
    EXPECT_NEAR(pattern_at(f, p, 0), 0.5 + 0.5 * octave_mean(f, p, f.octaves, false), 1e-6);
    f.pattern = Pattern::turbulence;
    const double absolute = octave_mean(f, p, f.octaves, true);
    EXPECT_NEAR(pattern_at(f, p, 0), absolute, 1e-6);
    f.pattern = Pattern::ridged;
    EXPECT_NEAR(pattern_at(f, p, 0), ridges / amplitude_sum, 2e-6);
    f.pattern = Pattern::marble;
    const double phase =
        2 * std::numbers::pi * (p[0] + double{f.distortion} * amplitude_sum * absolute);
    EXPECT_NEAR(pattern_at(f, p, 0), 0.5 + 0.5 * std::sin(phase), 1e-5);
  }
}

double smooth_step(double low, double high, double x) {
  const double f = std::min(std::max((x - low) / (high - low), 0.0), 1.0);
  return f * f * (3 - 2 * f);
}

/// The patterns of docs/reference/extensions/TESSERA_texture.md: rings and grain, clumps, patches
/// with scratched rims, flames.
TEST(ProceduralTexture, PatternsMatchFormulas) {
  for (int i = 0; i < 1000; ++i) {
    ProceduralTexture f = procedural(Pattern::wood);
    f.dimensions = 1 + i % 4;
    f.seed = 7;
    f.octaves = 1 + i % 5;
    f.distortion = 0.7f;
    auto p = point(i);
    const double distortion = double{f.distortion};
    const double fbm = octave_mean(f, p, f.octaves, false);
    const double rings =
        0.5 + 0.5 * std::sin(2 * std::numbers::pi * (std::hypot(p[0], p[2]) + distortion * fbm));
    const double grain = octave_mean(f, {24 * p[0], 0.5 * p[1], 24 * p[2], p[3]}, 1, false);
    // A few float operations; sines and steps multiply the error of their arguments by up to 10.
    EXPECT_NEAR(pattern_at(f, p, 0), std::clamp(0.15 + 0.7 * rings + 0.15 * grain, 0.0, 1.0), 1e-5);
    f.pattern = Pattern::clouds;
    EXPECT_NEAR(pattern_at(f, p, 0), smooth_step(-0.1, 0.5, fbm), 1e-5);
    f.pattern = Pattern::worn_metal;
    const double scratches = octave_mean(f, {0.7 * p[0], 16 * p[1], 16 * p[2], p[3]}, 1, false);
    EXPECT_NEAR(pattern_at(f, p, 0), smooth_step(-0.05, 0.15, fbm + 0.12 * distortion * scratches),
                2e-5);
    f.pattern = Pattern::fire;
    p[1] = p[1] / 1000 + 0.5;
    double amplitude_sum = 0;
    for (int k = 0; k < f.octaves; ++k) amplitude_sum += std::pow(double{f.gain}, k);
    const std::array<double, 4> rising = {3 * p[0], 3 * p[1] - 2 * p[3], 3 * p[2], p[3]};
    const double mean = double{render::kMeanAbsoluteNoise[static_cast<std::size_t>(f.dimensions)]};
    const double torn = amplitude_sum * (octave_mean(f, rising, f.octaves, true) - mean);
    EXPECT_NEAR(pattern_at(f, p, 0), std::clamp(1 - p[1] + 2 * distortion * p[1] * torn, 0.0, 1.0),
                1e-5);
  }
}

TEST(ProceduralTexture, StaysBetweenZeroAndOne) {
  for (const Pattern pattern :
       {Pattern::noise, Pattern::value_noise, Pattern::fbm, Pattern::turbulence, Pattern::ridged,
        Pattern::marble, Pattern::wood, Pattern::clouds, Pattern::worn_metal, Pattern::fire}) {
    const ProceduralTexture f = procedural(pattern);
    double low = 1, high = 0;
    for (int i = 0; i < 20000; ++i) {
      auto p = point(i);
      if (pattern == Pattern::fire) p[1] = p[1] / 1000 + 0.5;  // a flame's height
      for (const float footprint : {0.0f, 0.3f, 5.0f}) {
        const double s = pattern_at(f, p, footprint);
        low = std::min(low, s), high = std::max(high, s);
      }
    }
    EXPECT_GE(low, 0) << static_cast<int>(pattern);
    EXPECT_LE(high, 1) << static_cast<int>(pattern);
    EXPECT_GT(high - low, 0.4) << static_cast<int>(pattern);
  }
}

TEST(ValueNoise, IsSmoothBetweenRandomNumbers) {
  for (int dimensions = 1; dimensions <= 4; ++dimensions) {
    double sum = 0, squares = 0;
    constexpr int kCount = 1 << 14;
    for (int i = 0; i < kCount; ++i) {
      std::array<double, 4> p = point(i);
      for (double& x : p) x = std::floor(x);
      p[0] = i;  // no lattice point twice
      const double here = value_noise(dimensions, p, 5);
      sum += here, squares += here * here;
      if (i >= 100) continue;
      // Value and slope are continuous across the lattice plane: the change over twice a step is
      // twice the change over a step, up to second order.
      for (std::size_t k = 0; k < static_cast<std::size_t>(dimensions); ++k) {
        constexpr double kStep = 1.0 / 1024;
        auto before = p, after = p;
        before[k] -= kStep;
        after[k] += kStep;
        const double rise = value_noise(dimensions, after, 5) - here;
        const double fall = here - value_noise(dimensions, before, 5);
        EXPECT_NEAR(rise, fall, 11 * kStep * kStep);  // |second derivative| <= 12 / 1.25
      }
      EXPECT_NE(here, value_noise(dimensions, p, 6));
    }
    // On the lattice it is a uniform random number in [-1, 1], scaled.
    const double scale = std::pow(double{render::kSplineOvershoot}, -dimensions);
    EXPECT_NEAR(sum / kCount, 0, 5 * scale / std::sqrt(3.0 * kCount));
    EXPECT_NEAR(squares / kCount, scale * scale / 3, 0.03 * scale * scale);
  }
  EXPECT_EQ(value_noise(3, {0, 0x1p60, 0, 0}, 5), 0);
}

TEST(ProceduralTexture, LargeFootprintGivesMean) {
  for (const Pattern pattern :
       {Pattern::noise, Pattern::value_noise, Pattern::fbm, Pattern::turbulence, Pattern::marble}) {
    ProceduralTexture f = procedural(pattern);
    f.octaves = 4;
    double sum = 0, squares = 0;
    constexpr int kCount = 1 << 16;
    for (int i = 0; i < kCount; ++i) {
      const double s = pattern_at(f, point(i), 0);
      sum += s, squares += s * s;
    }
    const double mean = sum / kCount;
    const double error = std::sqrt((squares / kCount - mean * mean) / kCount);
    const double far = pattern_at(f, point(3), 1);
    // The mean of |noise| is a constant of four digits. Marble's sine has the period of the noise's
    // lattice, where noise is 0, so its true mean is 0.011 above the 0.5 that is used.
    const double known = pattern == Pattern::marble ? 0.012 : 1e-4;
    EXPECT_NEAR(far, mean, 4 * error + known) << static_cast<int>(pattern);
    for (int i = 0; i < 100; ++i) EXPECT_EQ(double{pattern_at(f, point(i), 1)}, far);
  }
}

/// Mean squared difference between the value filtered over a spot of `width` and the average over
/// the spot.
TEST(ProceduralTexture, FootprintRemovesFineDetail) {
  ProceduralTexture f = procedural(Pattern::fbm);
  f.octaves = 8;
  f.dimensions = 1;
  f.gain = 1;  // fine octaves as strong as coarse ones, so that aliasing would show
  // Between samples one spot apart the value may change by no more than a wave of half that
  // frequency allows, else it is aliased. Compared with no filter.
  const double spot = 1.0 / 16;
  double filtered = 0, unfiltered = 0;
  for (int i = 0; i < 4096; ++i) {
    const std::array<double, 4> a{i * spot + 0.013, 0, 0, 0}, b{(i + 1) * spot + 0.013, 0, 0, 0};
    const double d =
        pattern_at(f, b, static_cast<float>(spot)) - pattern_at(f, a, static_cast<float>(spot));
    const double u = pattern_at(f, b, 0) - pattern_at(f, a, 0);
    filtered += d * d, unfiltered += u * u;
  }
  // A feature of the fourth of 8 octaves is two footprints wide, which is fully visible; one of the
  // fifth is one footprint wide, so this and the finer octaves are removed. Coarse octaves change
  // little from one footprint to the next.
  EXPECT_LT(filtered, 0.35 * unfiltered);
  ProceduralTexture coarse = f;
  coarse.octaves = 4;
  for (int i = 0; i < 100; ++i) {
    // Amplitudes are fractions of the sum of all eight.
    EXPECT_NEAR(pattern_at(f, point(i), static_cast<float>(spot)) - 0.5,
                (pattern_at(coarse, point(i), 0) - 0.5) * 4 / 8, 1e-6);
  }
}

TEST(ProceduralTexture, RampIsLinearBetweenStops) {
  ProceduralTexture f = procedural(Pattern::fbm);
  f.ramp = {{0.25f, {1, 0, 0, 1}}, {0.5f, {0, 1, 0, 0.5f}}, {1, {0, 0, 1, 0}}};
  const auto expect = [&](float at, Vec4f color) {
    const Vec4f c = ramp_at(f, at);
    for (int k = 0; k < 4; ++k) EXPECT_NEAR(c[k], color[k], 1e-6) << at;
  };
  expect(0, {1, 0, 0, 1});
  expect(0.25f, {1, 0, 0, 1});
  expect(0.375f, {0.5f, 0.5f, 0, 0.75f});
  expect(0.75f, {0, 0.5f, 0.5f, 0.25f});
  expect(1, {0, 0, 1, 0});
  expect(2, {0, 0, 1, 0});
}

/// A tilted and moved unit square whose base colour is procedural.
Scene square(const ProceduralTexture& f, const render::Affine3d& placement, bool bump = false) {
  Scene scene = empty_scene();
  scene.procedural_textures.push_back(f);
  render::Texture texture;
  texture.procedural = 0;
  scene.textures.push_back(texture);
  Material m = lambert({1, 1, 1});
  (bump ? m.normal_texture : m.base_color_texture).texture = 0;
  const auto index = add_material(&scene, m);
  add_primitive(&scene, quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, index), placement);
  return scene;
}

Vec4f color_at(const Scene& scene, float b1, float b2) {
  const render::ShadingScene shading(scene);
  return base_color_at(shading, surface_at(shading, {0, 0, 0}, b1, b2, {0, 0, -1}));
}

TEST(ProceduralTextureOnSurface, UsesItsCoordinateSpace) {
  ProceduralTexture f = procedural(Pattern::noise);
  f.scale = {3, 5, 7};
  f.offset = {0.5f, 0.25f, 0.125f};
  const auto expected = [&](const Vec3d& p) {
    return 0.5 + 0.5 * gradient_noise(3, {p.x * 3 + 0.5, p.y * 5 + 0.25, p.z * 7 + 0.125, 0}, 0);
  };
  render::Affine3d placement = scaling(2, 3, 1);
  placement.translation = {10, 20, 30};
  // Barycentrics of the corners (0, 0), (1, 0), (1, 1).
  const Vec3d object{0.75, 0.5, 0};
  EXPECT_NEAR(color_at(square(f, placement), 0.25f, 0.5f).x, expected(object), 1e-6);
  f.space = ProceduralTexture::Space::world;
  Scene scene = square(f, placement);
  scene.center = {1, 2, 3};
  EXPECT_NEAR(color_at(scene, 0.25f, 0.5f).x, expected({10 + 1.5 + 1, 20 + 1.5 + 2, 30 + 3.0}),
              1e-6);
  f.space = ProceduralTexture::Space::uv;
  Scene flat = square(f, placement);
  flat.materials[1].base_color_texture.has_transform = true;
  flat.materials[1].base_color_texture.uv_matrix = {2, 0, 0.25f, 0, 4, 0};
  EXPECT_NEAR(color_at(flat, 0.25f, 0.5f).x, expected({2 * 0.75 + 0.25, 4 * 0.5, 0}), 1e-6);
}

TEST(ProceduralTextureOnSurface, BumpTiltsNormal) {
  // Marble without distortion is 0.5 + 0.5 sin(2 pi x): its slope is known.
  ProceduralTexture f = procedural(Pattern::marble);
  f.distortion = 0;
  f.octaves = 1;
  f.bump_height = 0.1f;
  for (const double scale : {1.0, 20.0}) {  // scale of the node, and so of the pattern
    const Scene scene = square(f, scaling(scale, scale, scale), true);
    const render::ShadingScene shading(scene);
    for (const float x : {0.1f, 0.3f, 0.55f, 0.9f}) {
      const auto p = surface_at(shading, {0, 0, 0}, x - 0.05f, 0.05f, {0, 0, -1});
      const Vec3f n = shading_normal_at(shading, p);
      const double slope =
          0.1 * std::numbers::pi * std::cos(2 * std::numbers::pi * double{x}) / scale;
      const double length = std::sqrt(1 + slope * slope);
      // Central differences over a 64th of a wave: 0.2 % of the largest slope.
      EXPECT_NEAR(n.x, -slope / length, 0.002 * 0.1 * std::numbers::pi / scale + 1e-6) << x;
      EXPECT_NEAR(n.y, 0, 1e-5);
      EXPECT_NEAR(n.z, 1 / length, 0.001);
    }
  }
}

TEST(ProceduralTextureOnSurface, IsSmoothFarAway) {
  // A wall of fine noise fills the view: from near, pixels differ; from far, they do not.
  const auto spread = [](double distance) {
    ProceduralTexture f = procedural(Pattern::fbm);
    f.octaves = 2;
    f.scale = {40, 40, 40};
    Scene scene = empty_scene();
    scene.procedural_textures.push_back(f);
    render::Texture texture;
    texture.procedural = 0;
    scene.textures.push_back(texture);
    Material m = lambert({1, 1, 1});
    m.unlit = true;
    m.base_color_texture.texture = 0;
    const auto index = add_material(&scene, m);
    // Placed by its vertices, so that object space is world space.
    add_primitive(&scene, quad({-4e3f, -4e3f, 0}, {8e3f, 0, 0}, {0, 8e3f, 0}, index));
    look_at(&scene, {0.3, 0.2, distance}, {0.3, 0.2, 0});
    const Picture picture = render_picture(scene, small_settings(16, 16, 4));
    double sum = 0, squares = 0;
    for (std::int32_t i = 0; i < 256; ++i) {
      const double v = picture.at(i % 16, i / 16).x;
      sum += v, squares += v * v;
    }
    EXPECT_NEAR(sum / 256, 0.5, 0.1);
    return std::sqrt(std::max(squares / 256 - sum / 256 * (sum / 256), 0.0));
  };
  EXPECT_GT(spread(0.2), 0.03);
  EXPECT_LT(spread(100), 1e-6);  // a pixel covers 180 waves
}

}  // namespace
}  // namespace tessera::testing
