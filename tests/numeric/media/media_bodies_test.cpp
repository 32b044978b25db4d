/// Media inside closed surfaces, heterogeneous media, and priorities of nested solids.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/numeric/media/media_scenes.h"
#include "tests/numeric/media/simpson.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/inspect/solid_check.h"
#include "worker/media/media.h"
#include "worker/media/medium_stack.h"
#include "worker/shading/microfacet/fresnel.h"

namespace tessera::testing {
namespace {

using render::Body;
using render::DensityGrid;
using render::Material;
using render::MaterialView;
using render::Medium;
using render::MediumStack;
using render::MediumView;
using render::ProceduralTexture;
using render::PunctualLight;
using render::Sampler;
using render::Scene;
using render::ShadingScene;
using render::Vec3d;
using render::Vec3f;

/// A wall of radiance 1 at z = -9 that faces +z.
void add_wall(Scene* scene) {
  const auto shine = add_material(scene, lamp(1));
  add_primitive(scene, quad({-90, -90, -9}, {180, 0, 0}, {0, 180, 0}, shine));
}

void expect_mean(const Picture& picture, double expected, double largest_error) {
  const double error = std::sqrt(3) * picture.mean_error();  // grey: one error, not three
  EXPECT_NEAR(picture.mean(), expected, 4 * error + 1e-6);
  EXPECT_LT(error, largest_error);
}

/// Rays start off surfaces 100 m wide by their rounding error, up to 1e-5 m at each of six
/// surfaces.
constexpr double kOffset = 2e-5;

TEST(MediumBody, InvisibleBoundaryEndsMedium) {
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  add_wall(&scene);
  add_slab(&scene, -1, 1, boundary(medium({0.3f, 0.3f, 0.3f})));
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), std::exp(-0.6), kOffset);
  // From its centre, half of it is in front of the camera.
  look_at(&scene, {0, 0, 0}, {0, 0, -1});
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), std::exp(-0.3), kOffset);
  // A body inside replaces it; the scene's medium surrounds both.
  add_slab(&scene, -0.5f, 0.25f, boundary(medium({1, 1, 1})));
  scene.atmosphere = render::Atmosphere{medium({0.1f, 0.1f, 0.1f}), {0, 0, 0}};
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), std::exp(-0.5 - 0.15 - 0.8), kOffset);
  look_at(&scene, {0, 0, 5}, {0, 0, 0});
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), std::exp(-0.75 - 0.3 * 1.25 - 0.4 - 0.8), kOffset);
}

TEST(MediumBody, AbsorptionDimsLight) {
  Scene scene = spot({0, 1, 4}, {0, 0, 0});
  const auto white = add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, quad({-50, 0, 50}, {100, 0, 0}, {0, 0, -100}, white));
  const auto ball = add_material(&scene, boundary(medium({0.5f, 0.5f, 0.5f})));
  add_primitive(&scene, box({-1, 2, -1}, {1, 3, 1}, false, ball));
  PunctualLight light;
  light.intensity = {1, 1, 1};
  light.position = {0, 4, 0};
  scene.lights.push_back(light);
  const double expected = std::exp(-0.5) / 16 / std::numbers::pi;
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), expected, 1e-6 * expected + 1e-9);
  scene.lights[0].position = {0, 2.5, 0};  // a lamp inside
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean() * 6.25 * std::numbers::pi, std::exp(-0.25), 1e-5);
}

TEST(MediumBody, SingleScatteringMatchesQuadrature) {
  Scene scene = spot({0, 0, 0}, {0, 0, -1});
  const auto fog = add_material(&scene, boundary(medium({0.2f, 0.2f, 0.2f}, {0.6f, 0.6f, 0.6f})));
  add_primitive(&scene, box({-1, -1, -4}, {1, 1, -2}, false, fog));
  PunctualLight light;
  light.intensity = {1, 1, 1};
  light.position = {0, 2, -3};
  scene.lights.push_back(light);
  const double expected = integral(
      [](double t) {
        const double d = std::hypot(2.0, t - 3);  // half of the distance lies in the box
        return 0.6 * std::exp(-0.8 * (t - 2 + d / 2)) / (4 * std::numbers::pi) / (d * d);
      },
      2, 4, 1000);
  expect_mean(middle(scene, 256, 1), expected, 0.02 * expected);
}

TEST(MediumBody, GlassAbsorbsLikeVolumeExtension) {
  Scene volume = empty_scene();
  set_constant_sky(&volume, 1);
  Scene fog = volume;
  Material m = glass(1.5f);
  m.attenuation_color = {0.5f, 0.25f, 1};
  m.attenuation_distance = 1;
  const auto by_volume = add_material(&volume, m);
  m.attenuation_color = {1, 1, 1};
  m.medium = medium({std::log(2.0f), std::log(4.0f), 0});
  const auto by_medium = add_material(&fog, m);
  add_primitive(&volume, sphere({0, 0, 0}, 1, 32, by_volume));
  add_primitive(&fog, sphere({0, 0, 0}, 1, 32, by_medium));
  auto settings = small_settings(8, 8, 16);
  settings.max_depth = 6;
  const Picture a = render_picture(volume, settings), b = render_picture(fog, settings);
  for (std::size_t i = 0; i < a.rgb.size(); ++i) {
    // The same paths, except where Russian roulette sees another last digit.
    EXPECT_NEAR(a.rgb[i], b.rgb[i], 1e-4) << i;
  }
}

/// Glass that neither reflects nor refracts. Russian roulette spares paths of throughput above 0.5.
Material tinted(float extinction = 0.1f) {
  const float c = std::exp(-extinction);
  Material m = glass(1);
  m.attenuation_color = {c, c, c};
  m.attenuation_distance = 1;
  return m;
}

TEST(CameraInside, OpaqueLampIsSeenThroughTheGlass) {
  for (const bool priority : {false, true}) {
    Scene scene = spot({0, 0, 5}, {0, 0, 0});
    Material water = tinted();
    water.optics.has_priority = priority;
    add_slab(&scene, -7, 9, water);
    add_slab(&scene, -1, 2, lamp(1));
    EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), std::exp(-0.3), kOffset);
    look_at(&scene, {0, 0, 10}, {0, 0, 0});  // from outside the path enters the glass
    EXPECT_NEAR(middle(scene, 1, 2, 1).mean(), std::exp(-0.7), kOffset);
  }
}

TEST(CameraInside, LightOnObjectsIsAbsorbedTwice) {
  Scene scene = spot({0, 1, 0}, {0, 0, 0});
  look_at(&scene, {0, 1, 1e-3}, {0, 0, 0});
  add_slab(&scene, -40, 40, tinted());
  const auto white = add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, quad({-20, 0, 20}, {40, 0, 0}, {0, 0, -40}, white));
  PunctualLight light;
  light.intensity = {1, 1, 1};
  light.position = {0, 2, 0};
  scene.lights.push_back(light);
  const double expected =
      std::exp(-0.3) / 4 / std::numbers::pi;  // 1 m to the camera, 2 m to the light
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), expected, 1e-5);
}

TEST(CameraInside, InnermostOfPlainSolidsCounts) {
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  add_slab(&scene, -7, 9, tinted());
  add_slab(&scene, 3, 6, glass(1));  // clear: 2 m of the way to the lamp
  add_slab(&scene, -1, 1, lamp(1));
  EXPECT_NEAR(middle(scene, 1, 4, 1).mean(), std::exp(-0.2), kOffset);
}

TEST(CameraInside, MediumContinuesBehindAnInnerSolid) {
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  add_slab(&scene, -7, 9, tinted());
  add_slab(&scene, 2, 4, glass(1));
  add_slab(&scene, -1, 1, lamp(1));
  EXPECT_NEAR(middle(scene, 1, 4, 1).mean(), std::exp(-0.2), kOffset);
}

TEST(CameraInside, SolidsOfOneMeshAreDistinguished) {
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  const auto outer = add_material(&scene, tinted());
  const auto inner = add_material(&scene, glass(1));
  const auto shine = add_material(&scene, lamp(1));
  render::Mesh mesh;
  mesh.primitives = std::vector<render::Primitive>{box({-50, -50, -7}, {50, 50, 9}, false, outer),
                                                   box({-50, -50, 2}, {50, 50, 4}, false, inner)};
  scene.meshes.push_back(mesh);
  render::Instance instance;
  instance.mesh = static_cast<std::int32_t>(scene.meshes.size()) - 1;
  scene.instances.push_back(instance);
  add_primitive(&scene, box({-40, -40, -1}, {40, 40, 1}, false, shine));
  EXPECT_NEAR(middle(scene, 1, 4, 1).mean(), std::exp(-0.2), kOffset);
  look_at(&scene, {0, 0, 3}, {0, 0, 0});
  EXPECT_NEAR(middle(scene, 1, 4, 1).mean(), std::exp(-0.1), kOffset);
}

TEST(CameraInside, EachLensPointHasItsOwnMedium) {
  Scene scene = empty_scene();
  look_at(&scene, {0, 0, 5}, {0, 0, 0});
  scene.camera.yfov = 1e-6;
  scene.camera.lens.radius = 1;
  scene.camera.lens.focus_distance = 12;
  // Half of the lens is in dense glass, the other in air.
  const auto dense = add_material(&scene, tinted(50));
  add_primitive(&scene, box({-50, 0, -50}, {50, 50, 50}, false, dense));
  const auto shine = add_material(&scene, lamp(1));
  add_primitive(&scene, box({-40, -40, -2}, {40, 40, -1}, false, shine));
  expect_mean(middle(scene, 1024, 1), 0.5, 0.01);
}

TEST(CameraInside, OutsideOfConcaveGlassNothingIsAbsorbed) {
  Scene scene = spot({0, 0, 0}, {0, 0, -1});
  // A hollow ball whose inside is air: the camera is in its box but not in its glass.
  const auto shell = add_material(&scene, tinted());
  add_primitive(&scene, box({-9, -9, -9}, {9, 9, 9}, false, shell));
  add_primitive(&scene, box({-8, -8, -8}, {8, 8, 8}, true, shell));
  add_slab(&scene, -6, -5, lamp(1));
  EXPECT_NEAR(middle(scene, 1, 1, 1).mean(), 1, 1e-6);
}

TEST(MediumBody, WhiteGlassVanishesInFurnace) {
  Scene scene = spot({0, 0, 5}, {0.3, 0, 0});
  set_constant_sky(&scene, 1);
  Material milk = glass(1.5f);
  milk.medium = medium({}, {2, 2, 2});
  milk.medium->anisotropy = 0.5f;
  const auto index = add_material(&scene, milk);
  add_primitive(&scene, sphere({0, 0, 0}, 1, 24, index));
  expect_mean(middle(scene, 64, 255), 1, 0.05);
}

/// Incoherent transmittance of three interfaces with all reflections between them.
double through_three(double r1, double r2, double r3) {
  const double t12 = (1 - r1) * (1 - r2) / (1 - r1 * r2);
  const double back = r2 + (1 - r2) * (1 - r2) * r1 / (1 - r1 * r2);
  return t12 * (1 - r3) / (1 - back * r3);
}

Material dielectric(float ior, int priority) {
  Material m = glass(ior);
  m.optics.has_priority = true;
  m.optics.priority = priority;
  return m;
}

constexpr double kWater = 1.333, kGlass = 1.5;
double reflectance(double n) {
  return (n - 1) * (n - 1) / ((n + 1) * (n + 1));
}

TEST(NestedDielectrics, WaterInGlassUsesRelativeIor) {
  EXPECT_NEAR(reflectance(kGlass / kWater), 0.0034749, 1e-6);
  EXPECT_NEAR(reflectance(kWater), 0.0203732, 1e-6);
  for (const bool glass_first : {true, false}) {
    Scene scene = spot({0, 0, 5}, {0, 0, 0});
    add_wall(&scene);
    // The water overlaps the glass, which has priority where both are.
    const Material water = dielectric(static_cast<float>(kWater), 1);
    const Material wall = dielectric(static_cast<float>(kGlass), 2);
    if (glass_first) {
      add_slab(&scene, 0, 1, wall);
      add_slab(&scene, -1, 0.5f, water);
    } else {
      add_slab(&scene, 0, 1, water);
      add_slab(&scene, -1, 0.5f, wall);
    }
    const double expected =
        glass_first
            ? through_three(reflectance(kGlass), reflectance(kGlass / kWater), reflectance(kWater))
            : through_three(reflectance(kWater), reflectance(kGlass / kWater), reflectance(kGlass));
    expect_mean(middle(scene, 256, 32), expected, 2e-3);
    // From inside the overlap; only the glass absorbs there.
    for (Material& m : scene.materials) {
      if (m.optics.priority == 1) m.medium = medium({5, 5, 5});
    }
    look_at(&scene, {0, 0, 0.25}, {0, 0, 1});
    scene.meshes[0].primitives = std::vector<render::Primitive>{
        quad({90, -90, 9}, {-180, 0, 0}, {0, 180, 0},
             scene.meshes[0].primitives[0].material)};  // the wall, on the other side
    if (glass_first) expect_mean(middle(scene, 256, 1), 1 - reflectance(kGlass), 5e-3);
  }
}

TEST(NestedDielectrics, AirGapReflectsTwice) {
  Scene scene = spot({0, 0, 5}, {0, 0, 0});
  add_wall(&scene);
  add_slab(&scene, 0, 1, dielectric(static_cast<float>(kGlass), 2));
  add_slab(&scene, -1, -0.01f, dielectric(static_cast<float>(kWater), 1));
  const double g = reflectance(kGlass), w = reflectance(kWater);
  // Each slab with all its internal reflections, then both.
  const double tg = (1 - g) / (1 + g), tw = (1 - w) / (1 + w);
  expect_mean(middle(scene, 256, 32), tg * tw / (1 - (1 - tg) * (1 - tw)), 3e-3);
}

TEST(NestedDielectrics, CoincidentSurfacesWarn) {
  // Water above a glass bottom: with a gap, with a shared surface, overlapping.
  for (const auto& [bottom, warnings] : {std::pair{0.01f, 0u}, {0.0f, 1u}, {-0.01f, 0u}}) {
    Scene scene = empty_scene();
    const auto wall = add_material(&scene, dielectric(static_cast<float>(kGlass), 2));
    const auto water = add_material(&scene, dielectric(static_cast<float>(kWater), 1));
    add_primitive(&scene, box({-2, -1, -2}, {2, 0, 2}, false, wall));
    add_primitive(&scene, box({-1, bottom, -1}, {1, 1, 1}, false, water));
    const auto problems = check_solids(scene);
    ASSERT_EQ(problems.size(), warnings) << bottom;
    if (warnings == 0) continue;
    EXPECT_NE(problems[0].message.find("surface coincides with nodes["), std::string::npos);
    for (Material& m : scene.materials) m.optics.has_priority = false;
    EXPECT_TRUE(check_solids(scene).empty()) << "without priorities nothing overlaps on purpose";
  }
}

TEST(MediumBody, OpenSurfaceWarns) {
  Scene scene = empty_scene();
  const auto fog = add_material(&scene, boundary(medium({1, 1, 1})));
  add_primitive(&scene, box({-1, -1, -1}, {1, 1, 1}, false, fog));
  EXPECT_TRUE(check_solids(scene).empty());
  add_primitive(&scene, quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, fog));
  const auto problems = check_solids(scene);
  ASSERT_EQ(problems.size(), 1u);
  EXPECT_NE(problems[0].message.find("encloses a medium, but the surface is open at 4 edges"),
            std::string::npos)
      << problems[0].message;
}

TEST(MediumStack, TopIsHighestRankedBody) {
  MaterialView low, high, fog, other;
  low.rank = 1;
  high.rank = 2;
  fog.rank = render::kBoundaryRank;
  const Body a{1, &low, nullptr}, b{2, &high, nullptr}, c{3, &fog, nullptr}, d{4, &low, nullptr};
  MediumStack in;
  EXPECT_EQ(in.top(), nullptr);
  in.enter(a);
  in.enter(c);
  EXPECT_EQ(in.top()->id, 1u) << "a solid outranks what only ends a medium";
  in.enter(d);
  EXPECT_EQ(in.top()->id, 4u) << "of equal ranks the last one";
  EXPECT_FALSE(in.hides(a));
  in.enter(b);
  EXPECT_EQ(in.top()->id, 2u);
  EXPECT_TRUE(in.hides(a));
  EXPECT_EQ(in.top_except(b)->id, 4u);
  in.cross(d, false);
  in.cross({5, &other, nullptr}, false);  // was not entered
  EXPECT_EQ(in.top_except(b)->id, 1u);
  in.cross(b, false);
  in.cross(a, false);
  EXPECT_EQ(in.top()->id, 3u);
  for (std::uint32_t i = 10; i < 30; ++i) in.enter({i, &low, nullptr});
  EXPECT_EQ(in.top()->id, 16u) << "at most kMaxDepth bodies";
}

/// A cloud of a few octaves with a density factor between 0.1 and 2.
Scene clouds() {
  Scene scene = empty_scene();
  ProceduralTexture p;
  p.pattern = ProceduralTexture::Pattern::turbulence;
  p.space = ProceduralTexture::Space::world;
  p.octaves = 3;
  p.scale = {1.5f, 1.5f, 1.5f};
  p.ramp = {{0, {0.1f, 0, 0, 1}}, {1, {2, 0, 0, 1}}};
  scene.procedural_textures.push_back(p);
  scene.center = {0.25, 0, 0};
  return scene;
}

std::shared_ptr<DensityGrid> ramp_grid() {
  auto grid = std::make_shared<DensityGrid>();
  grid->size = {3, 2, 4};
  grid->low = {-1, -1, 0};
  grid->high = {1, 1, 3};
  for (int i = 0; i < 24; ++i) grid->values.push_back(static_cast<float>((i * 7) % 5));
  return grid;
}

/// The density grid by its definition: a sum of trilinear weights over all lattice points.
double tents(const DensityGrid& grid, const Vec3d& p) {
  double sum = 0;
  for (int i = 0; i < 24; ++i) {
    const int at[3] = {i % 3, i / 3 % 2, i / 6};
    double w = 1;
    for (int k = 0; k < 3; ++k) {
      const double step = (double{grid.high[k]} - double{grid.low[k]}) /
                          (grid.size[static_cast<std::size_t>(k)] - 1);
      const bool inside = p[k] >= double{grid.low[k]} && p[k] <= double{grid.high[k]};
      w *= inside ? std::max(0.0, 1 - std::fabs((p[k] - double{grid.low[k]}) / step - at[k])) : 0;
    }
    sum += w * double{grid.values[static_cast<std::size_t>(i)]};
  }
  return sum;
}

TEST(HeterogeneousMedium, DensityStaysBelowBound) {
  const Scene scene = clouds();
  Medium m = medium({1, 1, 1}, {1, 1, 1});
  m.procedural = 0;
  const MediumView cloud = view_of_medium(scene, &m, {});
  m.procedural = render::kNone;
  m.grid = ramp_grid();
  const MediumView grid = view_of_medium(scene, &m, {});
  EXPECT_EQ(cloud.max_density, 2);
  EXPECT_EQ(grid.max_density, 4);
  double largest = 0;
  for (int i = 0; i < 4000; ++i) {
    const Vec3d p{-1.6 + 0.0008 * i, std::fmod(i * 0.377, 2.4) - 1.2,
                  std::fmod(i * 0.91, 3.4) - 0.2};
    const float density = density_at(cloud, nullptr, p);
    EXPECT_GE(density, 0.1f);
    EXPECT_LE(density, cloud.max_density);
    EXPECT_NEAR(density_at(grid, nullptr, p), tents(*m.grid, p + scene.center), 1e-5);
    largest = std::max(largest, double{density});
  }
  EXPECT_GT(largest, 0.7);
}

/// Means over many samples, with their standard errors.
struct Tally {
  Vec3d sum, squares;
  int count = 0;
  void add(const Vec3f& v) {
    sum += Vec3d(v);
    squares += Vec3d(v) * Vec3d(v);
    ++count;
  }
  void expect(const Vec3d& expected, double largest_error) const {
    for (int k = 0; k < 3; ++k) {
      const double mean = sum[k] / count;
      const double error = std::sqrt(std::max(squares[k] / count - mean * mean, 0.0) / count);
      EXPECT_NEAR(mean, expected[k], 4 * error + 1e-6) << k;
      EXPECT_LT(error, largest_error) << k;
    }
  }
};

TEST(HeterogeneousMedium, FlightMatchesQuadrature) {
  const Scene scene = clouds();
  const Vec3f scattering{0.4f, 0.1f, 0.7f}, absorption{0.1f, 0.6f, 0};
  Medium m = medium(absorption, scattering);
  m.procedural = 0;
  Medium of_grid = medium(absorption, scattering);
  of_grid.grid = ramp_grid();
  for (const Medium* source : {&m, &of_grid}) {
    const MediumView view = view_of_medium(scene, source, {});
    const render::ShadingScene shading(scene);
    render::MediumSegment segment;
    segment.medium = &view;
    segment.origin = {-0.6, -0.3, 0.2};
    segment.direction = normalize(Vec3d{0.3, 0.2, 1});
    segment.end = 1.9;
    const double thickness = integral(
        [&](double t) { return double{density_at(view, nullptr, segment.at(t))}; }, 0, 1.9, 4000);
    Vec3d through, met;
    for (int k = 0; k < 3; ++k) {
      const double sigma = double{view.extinction[k]};
      through[k] = std::exp(-sigma * thickness);
      met[k] = double{scattering[k]} / sigma * (1 - through[k]);
    }
    Tally ratio, passed, collided;
    for (int i = 0; i < 8000; ++i) {
      const Sampler sampler(7, 0, i, 0, 0);
      render::HashSequence chance(sampler);
      ratio.add(transmittance(segment, &chance));
      Vec3f throughput{1, 1, 1};
      double t = 0;
      const bool hit = collides_heterogeneous(segment, &chance, &throughput, &t);
      passed.add(hit ? Vec3f{} : throughput);
      collided.add(hit ? throughput : Vec3f{});
    }
    ratio.expect(through, 8e-3);
    passed.expect(through, 1e-2);
    collided.expect(met, 1e-2);
  }
}

TEST(HeterogeneousMedium, UniformDensityMatchesFog) {
  Scene is_homogeneous = spot({0, 0, 0}, {0, 0, -1});
  const auto black = add_material(&is_homogeneous, lambert({0, 0, 0}));
  add_primitive(&is_homogeneous, quad({-9, -9, -6}, {18, 0, 0}, {0, 18, 0}, black));
  PunctualLight light;
  light.intensity = {1, 1, 1};
  light.position = {0.3, 0, -2};
  is_homogeneous.lights.push_back(light);
  Scene grid = is_homogeneous;
  is_homogeneous.atmosphere =
      render::Atmosphere{medium({0.1f, 0.1f, 0.1f}, {0.4f, 0.4f, 0.4f}), {0, 0, 0}};
  grid.atmosphere = is_homogeneous.atmosphere;
  auto half = std::make_shared<DensityGrid>();
  half->size = {2, 2, 2};
  half->low = {-20, -20, -20};
  half->high = {20, 20, 20};
  half->values = {1, 1, 1, 1, 1, 1, 1, 1};
  grid.atmosphere->medium.grid = half;
  const Picture a = middle(is_homogeneous, 256, 3), b = middle(grid, 256, 3);
  const double error = std::sqrt(3) * std::hypot(a.mean_error(), b.mean_error());
  EXPECT_NEAR(a.mean(), b.mean(), 4 * error);
  EXPECT_LT(error, 0.04 * a.mean());
}

}  // namespace
}  // namespace tessera::testing
