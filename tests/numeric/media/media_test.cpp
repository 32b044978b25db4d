/// Media that fill a scene: formulas, quadrature, furnaces.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "tests/numeric/media/media_scenes.h"
#include "tests/numeric/media/simpson.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/media/medium_traversal.h"
#include "worker/media/phase.h"
#include "worker/render/path/transparency.h"
#include "worker/sampling/equi_angular.h"

namespace tessera::testing {
namespace {

using render::Atmosphere;
using render::Material;
using render::Medium;
using render::PunctualLight;
using render::Sampler;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

double henyey_greenstein(double g, double cosine) {
  return (1 - g * g) / (4 * std::numbers::pi * std::pow(1 + g * g - 2 * g * cosine, 1.5));
}

void fill(Scene* scene, const Medium& with, double radius = INFINITY) {
  scene->atmosphere = Atmosphere{with, {0, 0, 0}, radius};
}

PunctualLight point_light(float candela, const Vec3d& position) {
  PunctualLight light;
  light.intensity = {candela, candela, candela};
  light.position = position;
  return light;
}

TEST(PhaseFunction, IntegratesToOneAndMatchesSampling) {
  for (const double g : {0.0, 0.9, -0.9, 0.99, -0.99, 0.999, -0.999}) {
    const auto density = [g](double versine) {
      // Two unit vectors with 1 - cos = versine; the float function is called as in a render.
      const double sine = std::sqrt(versine * (2 - versine));
      const Vec3f to = Vec3f(Vec3d{sine, 0, 1 - versine});
      return double{render::phase::density(static_cast<float>(g), {0, 0, 1}, to)};
    };
    // Substituting 1 - cos = 2 x^4 (or 1 + cos) spreads the peak.
    const double sum = integral(
        [&](double x) {
          const double v = 2 * x * x * x * x;
          return 2 * std::numbers::pi * density(g < 0 ? 2 - v : v) * 8 * x * x * x;
        },
        0, 1, 4000);
    EXPECT_NEAR(sum, 1, 1e-3) << g;
    ASSERT_TRUE(std::isfinite(density(0)) && std::isfinite(density(2))) << g;
    // Compares samples with the distribution of 1 - cos.
    constexpr int kSamples = 200;
    double mean = 0;
    for (int i = 0; i < kSamples; ++i) {
      for (int j = 0; j < 8; ++j) {
        const auto u = static_cast<float>((i + 0.5) / kSamples);
        const Vec3f d =
            render::phase::sample(static_cast<float>(g), {0, 0, 1}, {u, static_cast<float>(j) / 8});
        EXPECT_NEAR(double{length(d)}, 1, 1e-6);
        mean += double{d.z} / (8 * kSamples);
        // 1 - cos from the peak, computed by the sine where the difference would cancel.
        const double a = std::fabs(g), z = double{d.z} * (g < 0 ? -1 : 1);
        const double x = double{d.x}, y = double{d.y};
        const double versine = z > 0 ? (x * x + y * y) / (1 + z) : 1 - z;
        const double root = std::sqrt((1 - a) * (1 - a) + 2 * a * versine);
        const double farther =
            a == 0 ? 1 - versine / 2 : (1 - a * a) / (2 * a) * (1 / root - 1 / (1 + a));
        EXPECT_NEAR(farther, double{u}, 1e-5) << g;
      }
    }
    EXPECT_NEAR(mean, g, 2e-3) << g;
  }
}

TEST(EquiAngular, SamplesFollowDensity) {
  const double inf = INFINITY;
  for (const auto& [begin, end] : {std::pair{0.0, 4.0}, {1.0, inf}, {0.0, inf}}) {
    const render::EquiAngular near({0, 0, 0}, {0, 0, 1}, {0.3, 0, 2}, begin, end);
    ASSERT_TRUE(near.usable());
    // The probability between the samples of two u is the difference of the u.
    const double a = near.sample(0.2), b = near.sample(0.7);
    EXPECT_NEAR(integral([&](double t) { return near.pdf(t); }, a, b, 2000), 0.5, 1e-6);
    EXPECT_GE(near.sample(0), begin);
    EXPECT_LE(near.sample(1 - 0x1p-30), end);
  }
  EXPECT_FALSE(render::EquiAngular({0, 0, 0}, {0, 0, 1}, {0, 0, 2}, 0, 4).usable());
}

TEST(FreeFlight, CollisionRateMatchesFormula) {
  const Vec3f scattering{0.3f, 1.0f, 0.05f}, extinction{0.5f, 1.0f, 0.4f};
  render::MediumView view;
  view.scattering = scattering;
  view.extinction = extinction;
  render::MediumSegment segment;
  segment.medium = &view;
  segment.end = 2;
  Vec3d passed, collided, passed2;
  constexpr int kPaths = 40000;
  for (int i = 0; i < kPaths; ++i) {
    const Sampler sampler(1, 0, i, 0, 0);
    render::MediumTraversal traversal;
    Vec3f throughput{1, 0.5f, 0.25f};
    traversal.begin(sampler.get_4d_fine(4).x, double{sampler.get_4d(4).y}, throughput);
    double t = 0;
    // Two segments, as if a transparent surface lay between them.
    segment.end = 0.7;
    bool hit = traversal.collides(segment, &throughput, &t);
    if (!hit) {
      segment.end = 1.3;
      hit = traversal.collides(segment, &throughput, &t);
    }
    const Vec3d w(throughput);
    (hit ? collided : passed) += w / double{kPaths};
    if (!hit) passed2 += w * w / double{kPaths};
  }
  for (int k = 0; k < 3; ++k) {
    const double start = k == 0 ? 1 : k == 1 ? 0.5 : 0.25;
    const double through = std::exp(-2.0 * double{extinction[k]});
    const double error = std::sqrt(std::max(passed2[k] - passed[k] * passed[k], 0.0) / kPaths);
    EXPECT_NEAR(passed[k], start * through, 4 * error + 1e-6) << k;
    EXPECT_LT(error, 4e-3);
    const double albedo = double{scattering[k]} / double{extinction[k]};
    EXPECT_NEAR(collided[k], start * albedo * (1 - through), 0.01) << k;
  }
}

TEST(Fog, AbsorptionFollowsBeer) {
  const Vec3f sigma{0.1f, 0.5f, 0};
  // A lamp seen through the medium.
  Scene seen = spot({0, 0, 5}, {0, 0, 0});
  const auto shine = add_material(&seen, lamp(3));
  add_primitive(&seen, quad({-9, -9, 0}, {18, 0, 0}, {0, 18, 0}, shine));
  fill(&seen, medium(sigma, {}));
  const Vec3d lamp_seen = middle(seen, 1, 1, 1).at(0, 0);
  // A point light over a floor: down to the floor, up to the camera.
  Scene lit = spot({0, 4, 0.1}, {0, 0, 0});
  const auto white = add_material(&lit, lambert({1, 1, 1}));
  add_primitive(&lit, quad({-50, 0, 50}, {100, 0, 0}, {0, 0, -100}, white));
  lit.lights.push_back(point_light(1, {1, 2, 0}));
  fill(&lit, medium(sigma, {}));
  const Vec3d floor_seen = middle(lit, 1, 1, 1).at(0, 0);
  // The sky behind a ball of the medium, through its centre and beside it.
  Scene sky = spot({0, 0, 5}, {0, 0, 0});
  set_constant_sky(&sky, 1);
  fill(&sky, medium(sigma, {}), 2);
  const Vec3d across = middle(sky, 1, 1, 1).at(0, 0);
  look_at(&sky, {2.1, 0, 5}, {2.1, 0, 0});
  const Vec3d beside = middle(sky, 1, 1, 1).at(0, 0);
  look_at(&sky, {0, 0, 1}, {0, 0, 0});
  const Vec3d inside = middle(sky, 1, 1, 1).at(0, 0);
  sky.atmosphere->radius = INFINITY;
  const Vec3d endless = middle(sky, 1, 1, 1).at(0, 0);
  for (int k = 0; k < 3; ++k) {
    const double s = double{sigma[k]};
    EXPECT_NEAR(lamp_seen[k], 3 * std::exp(-5 * s), 1e-5) << k;
    const double down = std::sqrt(5.0), up = std::sqrt(16.01);
    EXPECT_NEAR(floor_seen[k], 1 / std::numbers::pi / 5 * 2 / down * std::exp(-s * (down + up)),
                1e-6)
        << k;
    EXPECT_NEAR(across[k], std::exp(-4 * s), 1e-6) << k;
    EXPECT_EQ(beside[k], 1) << k;
    EXPECT_NEAR(inside[k], std::exp(-3 * s), 1e-6) << k;
    EXPECT_NEAR(endless[k], s > 0 ? 0 : 1, 0) << k;
  }
}

/// Light of one candela at `light` scattered once into the ray from the origin along -z.
double single_scattering(double absorption, double scattering, double g, const Vec3d& light,
                         double end) {
  const double sigma = absorption + scattering;
  return integral(
      [&](double x) {
        const double t = end * x * x * (3 - 2 * x);  // denser at both ends
        const Vec3d to_light = light - Vec3d{0, 0, -t};
        const double d = length(to_light);
        const double cosine = -to_light.z / d;
        return scattering * std::exp(-sigma * (t + d)) * henyey_greenstein(g, cosine) / (d * d) *
               end * 6 * x * (1 - x);
      },
      0, 1, 20000);
}

TEST(Fog, SingleScatteringMatchesQuadrature) {
  const Vec3f absorption{0.1f, 0, 0.3f}, scattering{0.2f, 0.5f, 0.1f};
  for (const float g : {0.0f, 0.7f, -0.5f}) {
    for (const Vec3d& light : {Vec3d{0.05, 0, -2}, Vec3d{1, 1, -3}, Vec3d{0, 2, 1}}) {
      Scene scene = spot({0, 0, 0}, {0, 0, -1});
      const auto black = add_material(&scene, lambert({0, 0, 0}));
      add_primitive(&scene, quad({-9, -9, -6}, {18, 0, 0}, {0, 18, 0}, black));
      scene.lights.push_back(point_light(1, light));
      fill(&scene, medium(absorption, scattering, g));
      const Picture picture = middle(scene, 256, 1);
      for (int k = 0; k < 3; ++k) {
        const Estimate got = channel(picture, static_cast<std::size_t>(k));
        const double expected =
            single_scattering(double{absorption[k]}, double{scattering[k]}, double{g}, light, 6);
        EXPECT_NEAR(got.mean, expected, 4 * got.error + 1e-6 * expected) << g << " " << light.x;
        EXPECT_LT(got.error, 0.03 * expected) << g << " " << light.x;
      }
    }
  }
}

TEST(Fog, AlbedoOneVanishesInFurnace) {
  Scene scene = spot({0, 0, 5}, {0.5, 0, 0});
  set_constant_sky(&scene, 1);
  fill(&scene, medium({}, {0.5f, 1, 0.2f}, 0.4f), 2);
  // A white object in the medium changes nothing.
  const auto white = add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, sphere({0.5f, 0, 0}, 0.5f, 16, white));
  expect_uniform(middle(scene, 256, 255), 1, 0.03);
}

TEST(Fog, VanishesBetweenUniformEmitters) {
  // Collisions sample lamps, equi-angular sampling finds places near lamps, and paths hit lamps:
  // each strategy contributes.
  Scene scene = spot({0, 0, 2}, {0.3, 0.2, 0});
  const auto shine = add_material(&scene, lamp(1));
  add_primitive(&scene, box({-3, -3, -3}, {3, 3, 3}, true, shine));
  for (const float g : {0.0f, 0.8f}) {
    fill(&scene, medium({}, {0.3f, 0.3f, 0.3f}, g));
    const Picture picture = middle(scene, 256, 255);
    const double error = std::sqrt(3) * picture.mean_error();
    EXPECT_NEAR(picture.mean(), 1, 4 * error + 1e-5) << g;
    EXPECT_LT(error, 0.015) << g;
  }
}

TEST(Fog, EmptyMediumKeepsEveryBit) {
  Scene scene = empty_scene();
  const auto grey = add_material(&scene, lambert({0.5f, 0.5f, 0.5f}));
  add_primitive(&scene, sphere({0, 0, 0}, 1, 16, grey));
  scene.lights.push_back(point_light(20, {2, 2, 2}));
  const Picture without = middle(scene, 8, 4);
  fill(&scene, medium({}, {}));
  EXPECT_EQ(middle(scene, 8, 4).rgb, without.rgb);
  // Also if the medium exists but not along the path.
  fill(&scene, medium({1, 1, 1}, {2, 2, 2}), 1);
  scene.atmosphere->center = {0, 0, -1e3};
  EXPECT_EQ(middle(scene, 8, 4).rgb, without.rgb);
}

// The limit counts transparent surfaces that the light passes. How many a ray meets before an
// opaque surface depends on the order of the traversal.
TEST(Fog, BlockedLightDoesNotCountTowardsLimit) {
  Scene scene = spot({3, 0, 0.5}, {0, 0, 0});
  Material hole = lambert({1, 1, 1});
  hole.base_color.w = 0;
  hole.alpha_mode = render::AlphaMode::blend;
  const auto floor = add_material(&scene, lambert({0.5f, 0.5f, 0.5f}));
  const auto veil = add_material(&scene, hole);
  add_primitive(&scene, quad({-2, -2, 0}, {4, 0, 0}, {0, 4, 0}, floor));
  const auto square = [](float z, std::int32_t material) {
    return quad({-0.01f, -0.01f, z}, {0.02f, 0, 0}, {0, 0.02f, 0}, material);
  };
  render::Primitive veils;  // twice the limit on each side of the middle
  veils.material = veil;
  for (int i = 0; i < 4 * render::kTransparencyLimit; ++i) {
    const render::Primitive q = square(1 + 0.002f * static_cast<float>(i), veil);
    const auto first = static_cast<std::uint32_t>(veils.positions.size());
    veils.positions.insert(veils.positions.end(), q.positions.begin(), q.positions.end());
    for (const auto& t : q.triangles) {
      veils.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
  }
  add_primitive(&scene, veils);
  scene.lights.push_back(point_light(1, {0, 0, 20}));
  fill(&scene, medium({1e-6f, 1e-6f, 1e-6f}, {}));
  const Picture open = middle(scene, 8, 1);
  EXPECT_GT(open.blocks[0].transparency_limit_count, 0u);
  scene.meshes.back().primitives = std::vector<render::Primitive>{
      veils, square(1 + 0.002f * 2.5f * static_cast<float>(render::kTransparencyLimit), floor)};
  const Picture blocked = middle(scene, 8, 1);
  EXPECT_EQ(blocked.mean(), 0);
  EXPECT_EQ(blocked.blocks[0].transparency_limit_count, 0u);
}

TEST(Fog, DenseMediumMatchesChandrasekhar) {
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  set_constant_sky(&scene, 1);
  fill(&scene, medium({2e5f, 2e5f, 2e5f}, {8e5f, 8e5f, 8e5f}), 1);
  const Picture picture = middle(scene, 512, 64);
  // Isotropic half-space, lit from everywhere, viewed along the normal: 1 - H(1) sqrt(1 - albedo)
  // with Chandrasekhar's H(1) = 1.9228 at albedo 0.8 (iterated below).
  const double albedo = 0.8;
  std::vector<double> h(200, 1);
  for (int round = 0; round < 200; ++round) {
    std::vector<double> next(h.size());
    for (std::size_t i = 0; i < h.size(); ++i) {
      const double mu = (static_cast<double>(i) + 0.5) / 200;
      double sum = 0;
      for (std::size_t j = 0; j < h.size(); ++j) {
        const double other = (static_cast<double>(j) + 0.5) / 200;
        sum += h[j] * other / (mu + other) / 200;
      }
      next[i] = 1 / (std::sqrt(1 - albedo) + albedo / 2 * sum);
    }
    h = next;
  }
  const double expected = 1 - h.back() * std::sqrt(1 - albedo);
  EXPECT_NEAR(picture.mean(), expected, 4 * std::sqrt(3) * picture.mean_error() + 2e-3);
  double truncated = 0;
  for (const auto& block : picture.blocks) truncated += block.truncated_energy;
  EXPECT_LT(truncated / (512 * 16), 1e-3 * expected);  // almost no path reaches 64 collisions
}

}  // namespace
}  // namespace tessera::testing
