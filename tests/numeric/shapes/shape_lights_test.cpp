// Hard cases 19, 58 and 59: emissive shapes, sampled by solid angle.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "tests/numeric/shapes/solid_scenes.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/light/light_sampler.h"

namespace tessera::render::testing {
namespace {

/// A scene with one lamp.
Scene lamp(const Shape& shape, const Affine3d& at, float radiance) {
  Scene scene = shape_scene(shape, at);
  Material material;
  material.emission = Vec3f{1, 1, 1} * radiance;
  scene.materials.push_back(material);
  return scene;
}

ShapeLight emitter_of(const Scene& scene) {
  const Instance& instance = scene.instances[0];
  return {instance.object_to_world, instance.world_to_object, *scene.meshes[0].shape};
}

/// Irradiance at the origin, facing +z, estimated by light samples on a grid of random numbers.
double irradiance(const Scene& scene, int side) {
  const ShadingScene shading(scene);
  const LightSampler lights(scene, shading);
  const LightSampleContext receiver = {{0, 0, 0}, {0, 0, 1}};
  double sum = 0;
  for (int i = 0; i < side * side; ++i) {
    const int row = i / side;
    const LightRandom u = {0.5, (i % side + 0.5) / side, (row + 0.5) / side};
    LightSample sample;
    if (!lights.sample(receiver, u, &sample)) continue;
    sum += std::max(0.0, static_cast<double>(sample.radiance_over_pdf.x) *
                             static_cast<double>(sample.direction.z));
    EXPECT_EQ(lights.emitter_pdf(receiver, sample.triangle, length(sample.target), 1), sample.pdf);
  }
  return sum / (side * side);
}

TEST(ShapeLights, TinyDistantSphereGivesItsLight) {
  const Scene scene = lamp(make_ellipsoid({1, 1, 1}), moved({0, 0, 1e6}), 1e12f);
  EXPECT_NEAR(irradiance(scene, 32) / std::numbers::pi, 1, 1e-5);
}

TEST(ShapeLights, SphereLightIsExactAtAnySize) {
  for (const double sine : {0.9, 0.1, 1e-3, 1e-4, 1e-5, 1e-6}) {
    const Scene scene = lamp(make_ellipsoid({sine, sine, sine}), moved({0, 0, 1}), 1);
    EXPECT_NEAR(irradiance(scene, 64) / (std::numbers::pi * sine * sine), 1, 1e-3) << sine;
  }
}

TEST(ShapeLights, FlatLightIsExactAtAnyDistance) {
  // Facing the origin: y down to -z.
  Affine3d facing;
  facing.rows = {Vec3d{1, 0, 0}, Vec3d{0, 0, 1}, Vec3d{0, -1, 0}};
  const double square[] = {0.239456, 0.968340, 0.999673}, heights[] = {1, 0.1, 0.01};
  for (int i = 0; i < 3; ++i) {
    facing.translation = {0, 0, heights[i]};
    EXPECT_NEAR(irradiance(lamp(make_rectangle(1, 1), facing, 1), 256) / std::numbers::pi,
                square[i], 1e-3);
    const double disc = 0.25 / (0.25 + heights[i] * heights[i]);
    EXPECT_NEAR(irradiance(lamp(make_disc(0.5), facing, 1), 256) / std::numbers::pi, disc, 2e-3);
  }
  facing.translation = {0, 0, 1e4};
  EXPECT_NEAR(irradiance(lamp(make_rectangle(1, 1), facing, 1e8f), 64), 1, 1e-3);
}

/// View factor from an element to the side of an upright cylinder; the element faces the axis at
/// `distance`, level with an end. Source: J. Howell, "A catalog of radiation heat transfer
/// configuration factors", B-31.
double cylinder_factor(double radius, double length, double distance) {
  const double l = length / radius, d = distance / radius;
  const double a = (d + 1) * (d + 1) + l * l, b = (d - 1) * (d - 1) + l * l;
  const double ends =
      (a - 2 * d) / std::sqrt(a * b) * std::atan(std::sqrt(a * (d - 1) / (b * (d + 1)))) -
      std::atan(std::sqrt((d - 1) / (d + 1)));
  return (std::atan(l / std::sqrt(d * d - 1)) + l * ends) / (std::numbers::pi * d);
}

/// An upright cylinder in front of the origin, from `below` it to `above` it.
Scene upright_tube(double radius, double below, double above, double distance, float radiance) {
  return lamp(make_cylinder(radius, above + below, true),
              moved({0, 0.5 * (above - below), distance}), radiance);
}

TEST(ShapeLights, CylinderIsExactAtAnyDistance) {
  for (const double radius : {1e-5, 1e-3, 0.02, 0.2}) {
    for (const double distance : {1.01 * radius, 1.5 * radius, 0.25, 1.0, 30.0}) {
      if (!(distance > radius)) continue;
      const double expected =
          cylinder_factor(radius, 0.7, distance) + cylinder_factor(radius, 1.3, distance);
      const double found =
          irradiance(upright_tube(radius, 0.7, 1.3, distance, 1), 256) / std::numbers::pi;
      EXPECT_NEAR(found / expected, 1, 2e-3) << radius << " at " << distance;
    }
  }
}

TEST(ShapeLights, CylinderIsExactAtAnySize) {
  for (const double scale : {1.0, 1e-2, 1e-4, 1e-6, 1e-7, 1e-8, 1e-9}) {
    const double radius = 0.01 * scale, half = 0.5 * scale;
    const double expected = 2 * cylinder_factor(radius, half, 1);
    // At this apparent size, samples are directed at a sphere around it.
    const bool beside = scale > 2e-8;
    const double found =
        irradiance(upright_tube(radius, half, half, 1, 1), beside ? 256 : 512) / std::numbers::pi;
    EXPECT_NEAR(found / expected, 1, beside ? 1e-3 : 0.03) << scale;
  }
}

/// Fraction of light samples that hit the lamp.
double share_that_meets(const Scene& scene) {
  const ShapeLight emitter = emitter_of(scene);
  Dice dice(7);
  const int n = 20'000;
  int met = 0;
  for (int i = 0; i < n; ++i) {
    const double u1 = static_cast<double>(dice.unit());
    ShapeHit hit;
    met += emitter.find({}, emitter.sample({}, u1, static_cast<double>(dice.unit())), hit) ? 1 : 0;
  }
  return met / static_cast<double>(n);
}

TEST(ShapeLights, ThinCylinderSamplesHit) {
  for (const double radius : {1e-4, 5e-3, 0.02}) {
    for (const double height : {0.0, 0.9, 1.7}) {  // beside it, and beyond its end
      const Scene scene = upright_tube(radius, 1 - height, 1 + height, 0.5, 1);
      EXPECT_GT(share_that_meets(scene), 1 - 3 * radius) << radius << " " << height;
    }
  }
  // A cone fills half of the cylinder around it, an ellipsoid three quarters or more, and a square
  // bar is at least 1 / sqrt(2) as wide.
  const Affine3d at = moved({0, 0, 1});
  EXPECT_GT(share_that_meets(lamp(make_cone(0.02, 2, true), at, 1)), 0.48);
  EXPECT_GT(share_that_meets(lamp(make_ellipsoid({1, 0.02, 0.02}), at, 1)), 0.75);
  EXPECT_GT(share_that_meets(lamp(make_box({2, 0.02, 0.02}), at, 1)), 0.69);
  const Shape ball = make_ellipsoid({0.02, 0.02, 0.02});  // scaled to be long
  EXPECT_GT(share_that_meets(lamp(ball, at * scaled({50, 1, 1}), 1)), 0.75);
}

/// Chi-square test over cells of equal solid angle inside the lamp, which must get equal numbers of
/// samples.
TEST(ShapeLights, CylinderSamplesAreUniform) {
  const Scene scene = upright_tube(0.2, 0.3, 1.7, 0.8, 1);
  const ShapeLight emitter = emitter_of(scene);
  const double solid_angle = emitter.solid_angle({});
  // About the y axis: the angle, and the sine of the height. The tube is within asin(1 / 4).
  constexpr int kAround = 12, kUp = 16;
  const double angle = std::asin(0.25), low = -0.3, high = 0.85;
  ASSERT_LT(high, 1.7 / std::hypot(1.7, std::sqrt(0.8 * 0.8 - 0.2 * 0.2)));
  ASSERT_GT(low, -0.3 / std::hypot(0.3, std::sqrt(0.8 * 0.8 - 0.2 * 0.2)));
  std::array<int, kAround * kUp> count{};
  Dice dice(11);
  const int n = 400'000;
  for (int i = 0; i < n; ++i) {
    const double u1 = static_cast<double>(dice.unit());
    const Vec3d w = emitter.sample({}, u1, static_cast<double>(dice.unit()));
    const double x = (std::atan2(w.x, w.z) + angle) / (2 * angle), y = (w.y - low) / (high - low);
    ASSERT_GE(x, -1e-12);
    ASSERT_LE(x, 1 + 1e-12);
    if (!(y >= 0 && y < 1)) continue;
    ShapeHit hit;
    ASSERT_TRUE(emitter.find({}, w, hit));
    const int column = std::clamp(static_cast<int>(x * kAround), 0, kAround - 1);
    ++count[static_cast<std::size_t>(static_cast<int>(y * kUp) * kAround + column)];
  }
  const double expected = n * 2 * angle * (high - low) / (kAround * kUp) / solid_angle;
  double chi2 = 0;
  for (const int c : count) chi2 += (c - expected) * (c - expected) / expected;
  // 192 degrees of freedom (the rest of the strip is one cell): 258 is exceeded once in 1,000
  // times.
  EXPECT_LT(chi2, 258);
  EXPECT_GT(expected, 1'000);
}

TEST(ShapeLights, MatchUniformDirectionSampling) {
  Dice dice(5);
  for (const Shape& shape :
       {make_cylinder(0.3, 1.5, true), make_box({1, 1, 1}), make_torus(0.5, 0.2),
        make_ellipsoid({1, 0.3, 0.2}), make_cylinder(0.3, 1.5, false), make_cone(0.3, 1.5, true),
        make_box({0.3, 0.2, 1.5}), make_one_sheet_hyperboloid(0.1, 0.3, 1.5, false)}) {
    for (const bool inside : {false, true}) {
      const double away = inside ? 0.45 : 1.5;
      Affine3d at = random_placement(dice, 0.8, {0, 0.1, away}, false);
      if (shape.capped) at = at * scaled({1, 0.7, 1.2}) * random_placement(dice, 1, {}, false);
      const Scene scene = lamp(shape, at, 1);
      const ShapeLight emitter = emitter_of(scene);
      double sum = 0;
      const int n = 400'000;
      for (int i = 0; i < n; ++i) {
        const Vec3d direction(dice.direction());
        ShapeHit hit;
        if (!emitter.find({}, direction, hit) || !hit.enters) continue;
        sum += std::max(0.0, direction.z) * 4 * std::numbers::pi;
      }
      const double expected = sum / n;
      EXPECT_NEAR(irradiance(scene, 400), expected, 0.03 * expected + 0.01);
    }
  }
}

/// Area of an ellipsoid of semi-axes 1, 1 and c < 1. Source: any table of integrals; e is its
/// eccentricity.
double oblate_area(double c) {
  const double e = std::sqrt(1 - c * c);
  return 2 * std::numbers::pi * (1 + c * c / e * std::atanh(e));
}

/// Flux of a lamp of radiance 1 through a sphere of radius 3 around it, estimated by light samples
/// at random points of the sphere, and its standard error. A convex lamp hides nothing of itself.
std::pair<double, double> flux(const Scene& scene, int samples) {
  const ShadingScene shading(scene);
  const LightSampler lights(scene, shading);
  Dice dice(26);
  double sum = 0, squares = 0;
  for (int i = 0; i < samples; ++i) {
    const Vec3f out = dice.direction();
    const LightSampleContext receiver = {out * 3.0f, -out};
    const double select = static_cast<double>(dice.unit()), u1 = static_cast<double>(dice.unit());
    const LightRandom u = {select, u1, static_cast<double>(dice.unit())};
    LightSample sample;
    double irradiance = 0;
    if (lights.sample(receiver, u, &sample)) {
      irradiance = std::max(0.0, -static_cast<double>(sample.radiance_over_pdf.x) *
                                     static_cast<double>(dot(sample.direction, out)));
    }
    sum += irradiance;
    squares += irradiance * irradiance;
  }
  const double n = samples, mean = sum / n, sphere = 4 * std::numbers::pi * 9;
  return {mean * sphere, std::sqrt((squares / n - mean * mean) / n) * sphere};
}

TEST(ShapeLights, FlattenedSphereEmitsByItsArea) {  // hard case 26
  // A diffuse lamp of radiance 1 emits pi a unit area. The shape is flat itself, or by its node.
  for (const double c : {0.5, 0.01}) {
    const double expected = std::numbers::pi * oblate_area(c);
    for (const auto& [shape, placement] : {std::pair{make_ellipsoid({1, 1, c}), Affine3d{}},
                                           {make_ellipsoid({1, 1, 1}), scaled({1, 1, c})},
                                           {make_ellipsoid({1, 1, 1}), scaled({-1, 1, c})}}) {
      const auto [found, error] = flux(lamp(shape, placement, 1), 1'000'000);
      EXPECT_LT(std::fabs(found - expected), 4 * error) << c;
      EXPECT_LT(error, 2e-3 * expected) << c;
    }
  }
}

TEST(ShapeLights, FlattenedMeshEmitsByItsArea) {  // hard case 26
  Scene scene = shape_scene(make_ellipsoid({1, 1, 1}));
  scene.meshes[0] = mesh_of({uv_sphere(32, 48, 1)});
  Material material;
  material.emission = {1, 1, 1};
  scene.materials.push_back(material);
  scene.instances.clear();
  place(scene, 0, scaled({1, 1, 0.01}));
  double area = 0;
  const Primitive& mesh = scene.meshes[0].primitives[0];
  for (const auto& triangle : mesh.triangles) {
    const auto corner = [&](std::size_t i) {
      const Vec3d p(mesh.positions[triangle[i]]);
      return Vec3d{p.x, p.y, p.z * 0.01};
    };
    area += 0.5 * length(cross(corner(1) - corner(0), corner(2) - corner(0)));
  }
  EXPECT_NEAR(area, oblate_area(0.01), 0.02);  // that of a polyhedron is less
  const auto [found, error] = flux(scene, 1'000'000);
  EXPECT_LT(std::fabs(found - std::numbers::pi * area), 4 * error);
  EXPECT_LT(error, 3e-3 * std::numbers::pi * area);
}

/// The far side of the shape is a receiver that lies on the lamp itself, whose rounded position may
/// be outside.
TEST(ShapeLights, SingleSidedShapesAreDarkInside) {
  Dice dice(9);
  for (const Shape& shape : {make_ellipsoid({1, 1, 1}), make_box({2, 2, 2}), make_torus(1, 0.4),
                             make_cylinder(1, 2, false), make_cone(1, 2, true)}) {
    for (const bool turned : {false, true}) {
      const Affine3d turn = turned ? random_placement(dice, 1.3, {}, false) : Affine3d{};
      Scene scene = lamp(shape, turn, 1);
      scene.materials[0].base_color = {0.8f, 0.8f, 0.8f, 1};
      scene.materials[0].metallic = 0;
      const bool torus = shape.form == Shape::Form::torus;
      const Vec3d eye = torus ? Vec3d{1, 0, 0} : Vec3d{0, 0.1, 0};
      tessera::testing::look_at(&scene, transform_point(turn, eye),
                                transform_point(turn, eye + Vec3d{0.3, -0.05, -1}));
      scene.camera.yfov = 1;
      const auto picture =
          tessera::testing::render_picture(scene, tessera::testing::small_settings(12, 12, 32));
      EXPECT_EQ(picture.mean(), 0) << static_cast<int>(shape.form) << turned;
    }
  }
}

}  // namespace
}  // namespace tessera::render::testing
