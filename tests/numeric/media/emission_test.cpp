/// Media that emit light: closed forms, quadrature, furnaces.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "tests/numeric/media/media_scenes.h"
#include "tests/numeric/media/simpson.h"
#include "worker/geometry/shapes/make_shape.h"
#include "worker/light/light_sampler.h"
#include "worker/sampling/exponential_distance.h"

namespace tessera::testing {
namespace {

using render::Affine3d;
using render::DensityGrid;
using render::Material;
using render::Medium;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

Medium glow(const Vec3f& emission, const Vec3f& absorption = {}, const Vec3f& scattering = {}) {
  Medium m = medium(absorption, scattering);
  m.emission = emission;
  return m;
}

/// A body filled with `with`.
std::size_t add_body(Scene* scene, const render::Shape& shape, const Medium& with,
                     const Affine3d& at = {}) {
  render::Primitive primitive;
  primitive.material = add_material(scene, boundary(with));
  const std::int32_t instance = add_primitive(scene, primitive, at);
  scene->meshes.back().shape = std::make_shared<const render::Shape>(shape);
  return static_cast<std::size_t>(instance);
}

/// A white floor in the plane y = 0, of which the camera sees the origin.
Scene floor_seen() {
  Scene scene = spot({0.5, 0.2, 0}, {0, 0, 0});
  const auto white = add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, quad({-90, 0, 90}, {180, 0, 0}, {0, 0, -180}, white));
  return scene;
}

void expect_near(const Estimate& got, double expected, double largest_error) {
  EXPECT_NEAR(got.mean, expected, 4 * got.error + 2e-5 * expected);
  EXPECT_LT(got.error, largest_error * expected);
}

TEST(ExponentialDistance, SamplesFollowDensity) {
  for (const double rate : {0.0, 1e-9, 0.5, 40.0}) {
    const render::ExponentialDistance distances(rate, 1, 3);
    const double a = distances.sample(0.2), b = distances.sample(0.7);
    EXPECT_NEAR(integral([&](double t) { return distances.pdf(t); }, a, b, 2000), 0.5, 1e-9)
        << rate;
    EXPECT_EQ(distances.sample(0), 1);
    EXPECT_LE(distances.sample(1 - 0x1p-53), 3);
  }
  const render::ExponentialDistance endless(0.5, 1, INFINITY);
  EXPECT_NEAR(endless.sample(0.5), 1 + 2 * std::log(2.0), 1e-12);
  EXPECT_NEAR(endless.pdf(3), 0.5 * std::exp(-1.0), 1e-12);
}

TEST(Emission, SlabFollowsFormula) {
  const Vec3f emission{3, 2, 0.5f}, absorption{0, 0.4f, 60};
  const auto radiance = [&](double length, int k) {
    const double e = double{emission[k]}, sigma = double{absorption[k]};
    return sigma > 0 ? e / sigma * (1 - std::exp(-sigma * length)) : e * length;
  };
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  add_slab(&scene, -1, 1, boundary(glow(emission, absorption)));
  const Vec3d across = middle(scene, 1, 1, 1).at(0, 0);
  look_at(&scene, {0, 0, 0.25}, {0, 0, -1});
  const Vec3d inside = middle(scene, 1, 1, 1).at(0, 0);
  look_at(&scene, {0, 0, 5}, {0, 0, 0});
  add_slab(&scene, -0.5f, 0.5f, lamp(7));
  const Vec3d before_lamp = middle(scene, 1, 1, 1).at(0, 0);
  for (int k = 0; k < 3; ++k) {
    const double near = 4e-5 * double{emission[k]};  // rays start off surfaces 100 m wide
    EXPECT_NEAR(across[k], radiance(2, k), near) << k;
    EXPECT_NEAR(inside[k], radiance(1.25, k), near) << k;
    const double through = std::exp(-0.5 * double{absorption[k]});
    EXPECT_NEAR(before_lamp[k], radiance(0.5, k) + 7 * through, near + 3e-4 * through) << k;
  }
}

TEST(Emission, BallOfScenesMediumFollowsFormula) {
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  scene.atmosphere = render::Atmosphere{glow({2, 2, 2}, {0.3f, 0.3f, 0.3f}), {0, 0, 0}, 1.5};
  const double expected = 2 / 0.3 * (1 - std::exp(-0.9));
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), expected, 1e-6 * expected);
  scene.atmosphere->radius = INFINITY;
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), 2 / 0.3, 1e-5);
}

TEST(Emission, ClearBallShowsItsChord) {
  for (const double beside : {0.0, 0.3, 0.6, 0.79}) {
    Scene scene = spot({beside, 0, 5}, {beside, 0, 0});
    add_body(&scene, render::make_ellipsoid({0.8, 0.8, 0.8}), glow({5, 5, 5}));
    const double expected = 10 * std::sqrt(0.64 - beside * beside);
    EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), expected, 3e-5 * expected) << beside;
  }
}

TEST(Emission, GridFollowsFormula) {
  // Emission and absorption have the same density, so only its integral along the ray matters.
  Medium m = glow({3, 3, 3}, {0.7f, 0.7f, 0.7f});
  auto grid = std::make_shared<DensityGrid>();
  grid->size = {2, 2, 3};
  grid->low = {-9, -9, -1};
  grid->high = {9, 9, 1};
  for (const float density : {0.0f, 2.0f, 1.0f})
    grid->values.insert(grid->values.end(), 4, density);
  m.grid = grid;
  const double expected = 3 / 0.7 * (1 - std::exp(-0.7 * (1 + 1.5)));
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  add_slab(&scene, -2, 2, boundary(m));
  expect_near(channel(middle(scene, 256, 1), 0), expected, 0.012);
  scene.atmosphere = render::Atmosphere{m, {0, 0, 0}};
  scene.instances.clear();
  expect_near(channel(middle(scene, 256, 1), 0), expected, 0.012);
}

// By Newton's shell theorem a uniform clear ball lights any receiver that sees all of it like a
// point in its centre.
TEST(Emission, ClearBallLightsFloorLikePoint) {
  for (const double radius : {0.01, 0.5, 0.75}) {
    Scene scene = floor_seen();
    add_body(&scene, render::make_ellipsoid(Vec3d{1, 1, 1} * radius), glow({4, 4, 4}),
             translation(0.75, 1, 0));
    const double power = 4 * 4.0 / 3 * std::numbers::pi * radius * radius * radius, d2 = 1.5625;
    const double expected = power / d2 * 0.8 / std::numbers::pi;
    expect_near(channel(middle(scene, 256, 1), 0), expected, 0.01);
  }
}

TEST(Emission, BlackBallLightsFloorLikeSurface) {
  Scene scene = floor_seen();
  add_body(&scene, render::make_ellipsoid({0.5, 0.5, 0.5}),
           glow({4e4f, 4e4f, 4e4f}, {1e4f, 1e4f, 1e4f}), translation(0, 1, 0));
  expect_near(channel(middle(scene, 256, 1), 0), 4 * 0.25, 0.01);  // radiance r^2 / d^2
}

/// The scene with its instances turned and stretched, as meshes, or moving.
Affine3d turned(double x, double y, double z) {
  Affine3d m = translation(x, y, z);
  m.rows = {Vec3d{0.8, -0.6, 0}, Vec3d{0.6, 0.8, 0}, Vec3d{0, 0, 1}};
  return m;
}

/// Radiance of the floor by a sum over the cells of a clear body of constant emission, whose object
/// space is [-half, half] with `inside(p)`.
template <typename Inside>
double floor_radiance(const Affine3d& at, const Vec3d& half, float emission, const Inside& inside) {
  constexpr int kCells = 60;
  const double cell = 8 * half.x * half.y * half.z / (kCells * kCells * kCells) *
                      std::fabs(render::determinant(at));
  double sum = 0;
  for (int i = 0; i < kCells * kCells * kCells; ++i) {
    const auto centre = [](int n) { return (n + 0.5) / kCells * 2 - 1; };
    const Vec3d p =
        Vec3d{centre(i % kCells), centre(i / kCells % kCells), centre(i / kCells / kCells)} * half;
    if (!inside(p)) continue;
    const Vec3d world = transform_point(at, p);
    const double d2 = dot(world, world);
    sum += cell * world.y / (d2 * std::sqrt(d2));
  }
  return sum * double{emission} / std::numbers::pi;
}

TEST(Emission, LongAndFlatBodiesMatchQuadrature) {
  const Affine3d at = turned(0.2, 0.9, -0.3);
  struct Case {
    const char* name;
    render::Shape shape;
    Vec3d half;
    bool (*inside)(const Vec3d&);
  };
  const Case cases[] = {
      {"tube",
       render::make_cylinder(0.05, 1, true),
       {0.05, 0.5, 0.05},
       [](const Vec3d& p) { return p.x * p.x + p.z * p.z < 0.0025; }},
      {"ring",
       render::make_torus(0.4, 0.1),
       {0.5, 0.1, 0.5},
       [](const Vec3d& p) {
         const double r = std::hypot(p.x, p.z) - 0.4;
         return r * r + p.y * p.y < 0.01;
       }},
      {"box",
       render::make_box({0.8, 0.1, 0.6}),
       {0.4, 0.05, 0.3},
       [](const Vec3d&) { return true; }},
  };
  for (const Case& c : cases) {
    Scene scene = floor_seen();
    add_body(&scene, c.shape, glow({9, 9, 9}), at);
    const Estimate got = channel(middle(scene, 1024, 1), 0);
    const double expected = floor_radiance(at, c.half, 9, c.inside);
    EXPECT_NEAR(got.mean, expected, 4 * got.error + 2e-3 * expected) << c.name;
    EXPECT_LT(got.error, 0.02 * expected) << c.name;
  }
}

TEST(Emission, InstancesAddUp) {
  const Affine3d places[] = {turned(-0.6, 0.7, 0.2), turned(0.4, 1.1, -0.8) * scaling(0.5, 2, 1)};
  Scene scene = floor_seen();
  const auto material = add_material(&scene, boundary(glow({2, 2, 2})));
  double expected = 0;
  add_primitive(&scene, box({-0.2f, -0.2f, -0.2f}, {0.2f, 0.2f, 0.2f}, false, material), places[0]);
  render::Instance second = scene.instances.back();
  second.object_to_world = places[1];
  second.world_to_object = *inverse(places[1]);
  scene.instances.push_back(second);
  for (const Affine3d& at : places) {
    expected += floor_radiance(at, {0.2, 0.2, 0.2}, 2, [](const Vec3d&) { return true; });
  }
  const Estimate got = channel(middle(scene, 1024, 1), 0);
  EXPECT_NEAR(got.mean, expected, 4 * got.error + 1e-3 * expected);
  EXPECT_LT(got.error, 0.02 * expected);
}

TEST(Emission, MovingBallGivesMeanOfPositions) {
  Scene scene = floor_seen();
  const std::size_t ball =
      add_body(&scene, render::make_ellipsoid({0.3, 0.3, 0.3}), glow({5, 5, 5}));
  scene.instances[ball].motion = 0;
  scene.key_times = {0, 1};
  scene.motions = {{translation(-1, 0.8, 0), translation(2, 0.8, 0)}};
  const double power = 5 * 4.0 / 3 * std::numbers::pi * 0.027;
  const double expected = integral(
      [&](double t) {
        const double x = 3 * t - 1, d2 = x * x + 0.64;
        return power / d2 * 0.8 / std::sqrt(d2) / std::numbers::pi;
      },
      0, 1, 200);
  expect_near(channel(middle(scene, 4096, 1), 0), expected, 0.03);
}

/// A flame: density by noise in a box.
Scene with_noise(Scene scene) {
  render::ProceduralTexture noise;
  noise.pattern = render::ProceduralTexture::Pattern::noise;
  noise.space = render::ProceduralTexture::Space::object;
  noise.scale = {3, 3, 3};
  noise.ramp = {{0.3f, {0, 0, 0, 1}}, {0.7f, {2, 2, 2, 1}}};
  scene.procedural_textures.push_back(noise);
  return scene;
}

Medium flame(const Vec3f& emission, const Vec3f& absorption) {
  Medium m = glow(emission, absorption);
  m.procedural = 0;
  return m;
}

TEST(Emission, FlameMatchesQuadrature) {
  const Affine3d at = turned(0.2, 1, 0.1);
  const Medium burning = flame({6, 3, 1}, {0.5f, 0.8f, 1});
  Scene seen = with_noise(spot({0, 1, 5}, {0.1, 1, 0}));
  add_body(&seen, render::make_box({1, 1.2, 1}), burning, at);
  const render::MediumView view = view_of_medium(seen, &burning, {});
  const Affine3d inwards = *inverse(at);
  const Vec3d eye{0, 1, 5}, along = normalize(Vec3d{0.1, 0, -5});
  const auto density = [&](const Vec3d& p) {
    const Vec3d q = transform_point(inwards, p);
    const bool inside = std::fabs(q.x) < 0.5 && std::fabs(q.y) < 0.6 && std::fabs(q.z) < 0.5;
    return inside ? double{density_at(view, &inwards, p)} : 0;
  };
  const Picture picture = middle(seen, 512, 1);
  for (int k = 0; k < 3; ++k) {
    double depth = 0, expected = 0;
    constexpr double kStep = 1e-4;
    for (double t = 4; t < 6; t += kStep) {
      const double here = density(eye + along * t) * kStep;
      expected += double{burning.emission[k]} * here *
                  std::exp(-double{burning.absorption[k]} * (depth + here / 2));
      depth += here;
    }
    const Estimate got = channel(picture, static_cast<std::size_t>(k));
    EXPECT_NEAR(got.mean, expected, 4 * got.error + 1e-3 * expected) << k;
    EXPECT_LT(got.error, 0.01 * expected) << k;
  }
}

TEST(Emission, ClearFlameLightsFloor) {
  const Affine3d at = turned(0.2, 1, 0.1);
  const Medium burning = flame({6, 6, 6}, {});
  Scene scene = with_noise(floor_seen());
  add_body(&scene, render::make_box({1, 1.2, 1}), burning, at);
  const render::MediumView view = view_of_medium(scene, &burning, {});
  constexpr int kCells = 60;
  double expected = 0;
  for (int i = 0; i < kCells * kCells * kCells; ++i) {
    const Vec3d p{(i % kCells + 0.5) / kCells - 0.5,
                  1.2 * ((i / kCells % kCells + 0.5) / kCells - 0.5),
                  (i / kCells / kCells + 0.5) / kCells - 0.5};
    const Vec3d world = transform_point(at, p);
    const double d2 = dot(world, world);
    const Affine3d none;
    expected += double{density_at(view, &none, p)} * world.y / (d2 * std::sqrt(d2));
  }
  expected *= 6 * 1.2 / (kCells * kCells * kCells) / std::numbers::pi;
  const Estimate got = channel(middle(scene, 1024, 1), 0);
  EXPECT_NEAR(got.mean, expected, 4 * got.error + 1e-3 * expected);
  EXPECT_LT(got.error, 0.02 * expected);
}

// A path that passes the rim of a cylinder must not lose count of its surfaces, or it gathers
// emission far behind it.
TEST(Emission, EdgesOfShapesLeakNothing) {
  for (const Vec3d& rim : {Vec3d{0, 0.5, 0.02}, Vec3d{0, 0.5, -0.02}, Vec3d{0.02, 0.5, 0}}) {
    for (const Vec3d& from : {Vec3d{0, 1, 1}, Vec3d{-0.3, -0.2, 1}, Vec3d{0.2, 0, 1}}) {
      Scene scene = spot(rim + from, rim);
      scene.camera.yfov = 1e-6;
      add_body(&scene, render::make_cylinder(0.02, 1, true), glow({1, 1, 1}));
      const auto black = add_material(&scene, lambert({0, 0, 0}));
      add_primitive(&scene, box({-100, -100, -100}, {100, 100, 100}, true, black));
      const Picture picture = middle(scene, 256, 1, 16);
      EXPECT_LT(*std::max_element(picture.rgb.begin(), picture.rgb.end()), 0.1)
          << rim.x << " " << rim.z << " " << from.x;
    }
  }
}

TEST(Emission, HigherPriorityHidesMedium) {
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  add_slab(&scene, -2, 2, boundary(glow({1, 1, 1})));
  Material water = glass(1);
  water.attenuation_color = Vec3f{1, 1, 1} * std::exp(-0.2f);
  water.attenuation_distance = 1;
  add_slab(&scene, -0.5f, 0.5f, water);
  EXPECT_NEAR(middle(scene, 1, 4, 1).mean(), 1.5 + 1.5 * std::exp(-0.2), 1e-4);
  // Nor does it light what is inside the solid: the floor is.
  Scene hidden = floor_seen();
  add_body(&hidden, render::make_ellipsoid({0.3, 0.3, 0.3}), glow({5, 5, 5}), translation(0, 1, 0));
  const auto around = add_material(&hidden, water);
  add_primitive(&hidden, box({-2, -1, -2}, {2, 2, 2}, false, around));
  EXPECT_EQ(middle(hidden, 64, 1).mean(), 0);
}

// In a cavity with walls at the temperature of the medium the radiance is that of the black body
// everywhere, whatever is inside.
TEST(Emission, ClosedFurnaceIsUniform) {
  for (const Vec3f& scattering : {Vec3f{}, Vec3f{0.5f, 1, 0.2f}}) {
    Scene scene = spot({0, 0, 5}, {0.5, 0, 0});
    set_constant_sky(&scene, 3);
    const Vec3f absorption{0.4f, 1, 2};
    add_body(&scene, render::make_ellipsoid({2, 2, 2}),
             glow(absorption * 3.0f, absorption, scattering));
    Material grey = lambert({0.5f, 0.5f, 0.5f});
    grey.emission = {1.5f, 1.5f, 1.5f};  // emissivity 0.5
    const auto ball = add_material(&scene, grey);
    add_primitive(&scene, sphere({0.5f, 0, 0}, 0.5f, 16, ball));
    expect_uniform(middle(scene, 256, 255), 3, 0.03);
  }
}

TEST(Emission, ScenesMediumIsUniformFurnace) {
  for (const float scattering : {0.0f, 0.7f}) {
    Scene scene = spot({0, 0, 1}, {0.5, 0, 0});
    scene.atmosphere =
        render::Atmosphere{glow({2, 2, 2}, {1, 1, 1}, Vec3f{1, 1, 1} * scattering), {0, 0, 0}};
    const auto white = add_material(&scene, lambert({1, 1, 1}));
    add_primitive(&scene, sphere({0.5f, 0, 0}, 0.5f, 16, white));
    expect_uniform(middle(scene, 256, 255), 2, 0.05);
  }
}

TEST(Emission, FogScattersLightOfFlame) {
  // Single scattering of a clear ball, which acts as a point outside of itself.
  Scene scene = spot({0, 0, 0}, {0, 0, -1});
  const auto black = add_material(&scene, lambert({0, 0, 0}));
  add_primitive(&scene, quad({-9, -9, -6}, {18, 0, 0}, {0, 18, 0}, black));
  add_body(&scene, render::make_ellipsoid({0.1, 0.1, 0.1}), glow({9, 9, 9}), translation(0, 2, -2));
  scene.atmosphere = render::Atmosphere{medium({}, {0.3f, 0.3f, 0.3f}), {0, 0, 0}};
  const double power = 9 * 4.0 / 3 * std::numbers::pi * 1e-3;
  const double expected = integral(
      [&](double t) {
        const double d = std::hypot(2.0, t - 2);
        return 0.3 * power / (4 * std::numbers::pi) / (d * d) *
               std::exp(-0.3 * (t + d - 0.075));  // the ball is clear: 3/4 r on average
      },
      0, 6, 1000);
  const Estimate got = channel(middle(scene, 1024, 1), 0);
  EXPECT_NEAR(got.mean, expected, 4 * got.error + 1e-3 * expected);
  EXPECT_LT(got.error, 0.02 * expected);
}

}  // namespace
}  // namespace tessera::testing
