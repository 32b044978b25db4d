// Hard cases 19, 58 and 59: shapes that emit, sampled by solid angle.

#include <gtest/gtest.h>

#include <cmath>

#include "tests/numeric/solid_scenes.h"
#include "worker/light/light_table.h"

namespace tessera::render::testing {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// A lamp of radiance `radiance`, alone.
Scene lamp(const Shape& shape, const Affine3d& at, float radiance) {
  Scene scene = shape_scene(shape, at);
  Material material;
  material.emission = Vec3f{1, 1, 1} * radiance;
  scene.materials.push_back(material);
  return scene;
}

/// Irradiance at the origin, looking to +z, by light samples on a grid of random numbers.
double irradiance(const Scene& scene, int side) {
  const ShadingScene shading(scene);
  const LightTable lights(scene, shading);
  const LightReceiver receiver = {{0, 0, 0}, {0, 0, 1}};
  double sum = 0;
  for (int i = 0; i < side * side; ++i) {
    const LightRandom u = {0.5, (i % side + 0.5) / side, (i / side + 0.5) / side};
    LightSample sample;
    if (!lights.sample(receiver, u, &sample)) continue;
    sum += std::max(0.0, static_cast<double>(sample.radiance_over_pdf.x) *
                             static_cast<double>(sample.direction.z));
    EXPECT_EQ(lights.emitter_pdf(receiver, sample.triangle, length(sample.target), 1), sample.pdf);
  }
  return sum / (side * side);
}

TEST(HardCase19, ATinySphereFarAwayGivesItsLight) {
  const Scene scene = lamp(make_ellipsoid({1, 1, 1}), moved({0, 0, 1e6}), 1e12f);
  EXPECT_NEAR(irradiance(scene, 32) / kPi, 1, 1e-5);
}

TEST(HardCase59, SpheresOfAnySolidAngleGiveTheirLight) {
  for (const double sine : {0.9, 0.1, 1e-3, 1e-4, 1e-5, 1e-6}) {
    const Scene scene = lamp(make_ellipsoid({sine, sine, sine}), moved({0, 0, 1}), 1);
    EXPECT_NEAR(irradiance(scene, 64) / (kPi * sine * sine), 1, 1e-3) << sine;
  }
}

TEST(HardCase58, FlatShapesGiveTheirLightAtAnyDistance) {
  // Facing the origin: y down to -z.
  Affine3d facing;
  facing.rows = {Vec3d{1, 0, 0}, Vec3d{0, 0, 1}, Vec3d{0, -1, 0}};
  const double square[] = {0.239456, 0.968340, 0.999673}, heights[] = {1, 0.1, 0.01};
  for (int i = 0; i < 3; ++i) {
    facing.translation = {0, 0, heights[i]};
    EXPECT_NEAR(irradiance(lamp(make_rectangle(1, 1), facing, 1), 256) / kPi, square[i], 1e-3);
    const double disc = 0.25 / (0.25 + heights[i] * heights[i]);
    EXPECT_NEAR(irradiance(lamp(make_disc(0.5), facing, 1), 256) / kPi, disc, 2e-3);
  }
  facing.translation = {0, 0, 1e4};
  EXPECT_NEAR(irradiance(lamp(make_rectangle(1, 1), facing, 1e8f), 64), 1, 1e-3);
}

TEST(ShapeLights, GiveWhatUniformDirectionsFind) {
  Dice dice(5);
  for (const Shape& shape :
       {make_cylinder(0.3, 1.5, true), make_box({1, 1, 1}), make_torus(0.5, 0.2),
        make_ellipsoid({1, 0.3, 0.2}), make_cylinder(0.3, 1.5, false)}) {
    for (const bool inside : {false, true}) {
      const double away = inside ? 0.45 : 1.5;
      const Affine3d at = random_placement(dice, 0.8, {0, 0.1, away}, false);
      const Scene scene = lamp(shape, at, 1);
      const ShapeEmitter emitter(scene.instances[0], shape);
      double sum = 0;
      const int n = 400'000;
      for (int i = 0; i < n; ++i) {
        const Vec3d direction(dice.direction());
        ShapeHit hit;
        if (!emitter.find({}, direction, hit) || !hit.enters) continue;
        sum += std::max(0.0, direction.z) * 4 * kPi;
      }
      const double expected = sum / n;
      EXPECT_NEAR(irradiance(scene, 400), expected, 0.03 * expected + 0.01);
    }
  }
}

}  // namespace
}  // namespace tessera::render::testing
