// Hard cases 10, 57, 61 and 66: emissive triangles behind walls, thin as needles, seen from behind,
// and in the hundreds.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/light/light_sampler.h"
#include "worker/shading/surface/surface.h"

namespace tessera::testing {
namespace {

using render::LightSampleContext;
using render::LightSampler;
using render::Material;
using render::Primitive;
using render::Scene;
using render::ShadingScene;
using render::Vec3d;
using render::Vec3f;
using render::testing::Dice;

/// A unit room that two sheets 1e-5 apart divide at z = 0, with a lamp at z = -0.4 and the camera
/// at z = `eye`, looking along z at the sheets. The sheet on the camera's side passes all the light
/// that it scatters, so that paths and shadow rays leave it towards the lamp; the other is opaque.
Scene divided_room(const render::Affine3d& placement, double eye) {
  Scene scene = empty_scene();
  const auto white = add_material(&scene, lambert({0.9f, 0.9f, 0.9f}));
  const auto light = add_material(&scene, lamp(1e6f));
  Material thin = lambert({0.9f, 0.9f, 0.9f});
  thin.diffuse_transmission.factor = 1;
  const auto passing = add_material(&scene, thin);
  add_primitive(&scene, box({-0.5f, -0.5f, -0.5f}, {0.5f, 0.5f, 0.5f}, true, white), placement);
  for (const float z : {0.0f, -1e-5f}) {
    const auto material = z == 0 ? passing : white;
    add_primitive(&scene, quad({-0.6f, -0.6f, z}, {1.2f, 0, 0}, {0, 1.2f, 0}, material), placement);
  }
  add_primitive(&scene, quad({-0.2f, -0.2f, -0.4f}, {0.4f, 0, 0}, {0, 0.4f, 0}, light), placement);
  look_at(&scene, {0.1, -0.05, eye}, {0, 0.02, 0});
  scene.camera.camera_to_world = placement * scene.camera.camera_to_world;
  scene.camera.yfov = 2;  // the sheet and the walls where they meet it
  return scene;
}

TEST(ThinWalls, NoRadiancePasses) {             // hard case 10
  auto settings = small_settings(32, 32, 256);  // of four pictures: a million samples
  settings.max_depth = 6;
  Dice dice(4);
  for (int i = 0; i < 4; ++i) {
    const render::Affine3d placement =
        i == 0
            ? render::Affine3d{}
            : render::testing::random_placement(dice, 1, Vec3d(dice.vector()) * (i - 1.0), false);
    const Picture dark = render_picture(divided_room(placement, 0.45), settings);
    for (const double value : dark.rgb) ASSERT_EQ(value, 0) << i;
    auto few = settings;
    few.spp = 4;
    EXPECT_GT(render_picture(divided_room(placement, -0.3), few).mean(), 1e4) << "the lamp's side";
  }
}

/// A floor at y = 0 and a camera above that sees a tiny spot of it at the origin.
Scene floor_scene() {
  Scene scene = empty_scene();
  const auto white = add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, quad({-9, 0, 9}, {18, 0, 0}, {0, 0, -18}, white));
  look_at(&scene, {0.3, 0.5, 0.2}, {0, 0, 0});
  scene.camera.yfov = 1e-6;
  return scene;
}

TEST(AreaLights, SurfaceBehindLampIsDark) {  // hard case 61
  auto settings = small_settings(2, 2, 64);
  for (const bool mirrored : {false, true}) {
    Scene scene = floor_scene();
    const auto light = add_material(&scene, lamp(1));
    // Facing up, away from the floor; a mirrored instance keeps its side.
    add_primitive(&scene, quad({-1, 1, 1}, {2, 0, 0}, {0, 0, -2}, light),
                  scaling(mirrored ? -1 : 1, 1, 1));
    EXPECT_EQ(render_picture(scene, settings).mean(), 0) << mirrored;
    scene.materials[static_cast<std::size_t>(light)].double_sided = true;
    EXPECT_GT(render_picture(scene, settings).mean(), 0.3) << mirrored;
  }
}

TEST(AreaLights, DoubleSidedSurfaceIsLitAlikeFromBehind) {  // hard case 61
  const auto radiance = [](double side, bool double_sided) {
    Scene scene = empty_scene();
    Material sheet = lambert({0.8f, 0.4f, 0.2f});
    sheet.double_sided = double_sided;
    const auto material = add_material(&scene, sheet);
    add_primitive(&scene, quad({-9, 0, 9}, {18, 0, 0}, {0, 0, -18}, material));
    render::PunctualLight point;
    point.intensity = {1, 1, 1};
    point.position = {0, side, 0};
    scene.lights.push_back(point);
    look_at(&scene, {0.3, 0.5 * side, 0.2}, {0, 0, 0});
    scene.camera.yfov = 1e-6;
    return render_picture(scene, small_settings(1, 1, 4)).at(0, 0);
  };
  const Vec3d front = radiance(1, true);
  EXPECT_NEAR(front.x, 0.8 / std::numbers::pi, 1e-6);
  EXPECT_EQ(radiance(-1, true), front) << "the normal is turned towards the viewer";
  EXPECT_EQ(radiance(1, false), front);
}

TEST(AreaLights, TinyDistantMeshGivesItsLight) {  // hard case 19
  // A ball of radius 1 at 1e6, of radiance 1e12, lights a white floor that faces it with pi: as a
  // mesh its triangles are sampled by area. The mesh covers the disc of its outline.
  Scene scene = floor_scene();
  constexpr int kSegments = 24;
  add_primitive(&scene, sphere({0, 1e6f, 0}, 1, kSegments, add_material(&scene, lamp(1e12f))));
  auto settings = small_settings(8, 8, 1024);
  settings.max_depth = 1;
  const Picture picture = render_picture(scene, settings);
  // Seen along its axis, a polygon of 24 corners. Vertices at 1e6 are multiples of 1/16 along y.
  const double outline =
      kSegments / 2.0 * std::sin(2 * std::numbers::pi / kSegments) / std::numbers::pi;
  const double error = std::sqrt(3) * picture.mean_error();
  EXPECT_NEAR(picture.mean(), outline, 4 * error + 1e-5);
  EXPECT_LT(error, 0.02);
}

TEST(AreaLights, SunBehindGlassReachesNoFloor) {  // hard case 60
  // A directional light is no surface that a path could meet behind the glass, and shadow rays do
  // not refract: nothing samples this light, which is documented, and no part of it is invented.
  Scene scene = floor_scene();
  const auto pane = add_material(&scene, glass(1.5f));
  add_primitive(&scene, box({-50, 1, -50}, {50, 1.5f, 50}, false, pane));
  render::PunctualLight sun;
  sun.kind = render::PunctualLight::Kind::directional;
  sun.intensity = {1, 1, 1};
  sun.direction = {0, -1, 0};
  scene.lights.push_back(sun);
  auto settings = small_settings(2, 2, 64);
  EXPECT_EQ(render_picture(scene, settings).mean(), 0);
  scene.instances.pop_back();
  EXPECT_NEAR(render_picture(scene, settings).mean(), 1 / std::numbers::pi, 1e-5);
}

/// Irradiance at the origin, facing +y, from a triangle above of radiance 1. Source: J. Lambert,
/// "Photometria", 1760: half the sum over the edges of the angle they subtend times the cosine of
/// the normal of the plane through the origin and the edge.
double triangle_irradiance(const std::array<Vec3f, 3>& corners) {
  double sum = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3d a = normalize(Vec3d(corners[i])), b = normalize(Vec3d(corners[(i + 1) % 3]));
    const Vec3d across = cross(a, b);
    const double sine = length(across);
    sum += std::atan2(sine, dot(a, b)) * (across.y / sine) / 2;
  }
  return std::fabs(sum);
}

/// A lamp 2 m long and `width` wide, 1 m above the origin, that faces down.
std::array<Vec3f, 3> needle(float width) {
  return {Vec3f{-1, 1, 0}, Vec3f{1, 1, 0}, Vec3f{0.25f, 1, width}};
}

Primitive triangle(const std::array<Vec3f, 3>& corners, std::int32_t material) {
  Primitive p;
  p.positions.assign(corners.begin(), corners.end());
  p.triangles = {{0, 1, 2}};
  p.material = material;
  return p;
}

TEST(AreaLights, NeedlesGiveTheirLight) {  // hard case 57
  for (const float width : {1e-1f, 1e-3f, 1e-5f, 1e-7f, 1e-12f}) {
    Scene scene = floor_scene();
    add_primitive(&scene, triangle(needle(width), add_material(&scene, lamp(1 / width))));
    auto settings = small_settings(4, 4, 4096);
    settings.max_depth = 1;
    const Picture picture = render_picture(scene, settings);
    const double expected =
        triangle_irradiance(needle(width)) / static_cast<double>(width) / std::numbers::pi;
    const double error = std::sqrt(3) * picture.mean_error();
    // The sum cancels from 1 to the width, and the cosines of the planes have errors of 2^-52.
    const double rounding = 4 * 0x1p-52 / static_cast<double>(width);
    EXPECT_NEAR(picture.mean(), expected, 4 * error + 1e-5 * expected + rounding) << width;
    EXPECT_LT(error, 2e-3 * expected) << width;
    for (const auto& block : picture.blocks) EXPECT_TRUE(block.dropped.empty()) << width;
  }
}

TEST(AreaLights, RaysThatHitNeedlesHaveFiniteWeights) {  // hard case 57
  Dice dice(57);
  int hits = 0;
  for (const float width : {1e-3f, 1e-5f, 1e-7f, 1e-9f}) {
    Scene scene = floor_scene();
    const auto corners = needle(width);
    add_primitive(&scene, triangle(corners, add_material(&scene, lamp(1))));
    const ShadingScene shading(scene);
    const LightSampler lights(scene, shading);
    const render::SceneAccel accel(scene, render::sequential());
    for (int i = 0; i < 5'000; ++i) {
      // Also from points in the needle's plane, where its cosine is 0 or nearly so.
      Vec3f from = {3 * dice.both(), 0, 3 * dice.both()};
      if (i % 4 == 0) from = {3 * dice.both(), i % 8 == 0 ? 1.0f : 1 - 1e-6f, 3 * dice.both()};
      const float b1 = dice.unit(), b2 = (1 - b1) * dice.unit();
      const Vec3f to = corners[0] + (corners[1] - corners[0]) * b1 + (corners[2] - corners[0]) * b2;
      render::Ray ray;
      ray.origin = from;
      ray.direction = normalize(to - from);
      render::Hit hit;
      if (!accel.closest_hit(ray, hit) || hit.id.instance != 1) continue;
      ++hits;
      const float cosine = std::fabs(ray.direction.y);
      const LightSampleContext context{from, {0, 1, 0}, false};
      const float density = lights.emitter_pdf(context, hit.id, hit.t, cosine);
      ASSERT_FALSE(std::isnan(density)) << width << " " << i;
      ASSERT_GE(density, 0) << width << " " << i;
      for (const float of_bsdf : {1e-6f, 0.3f, 1e6f}) {
        const float weight = render::power_heuristic(of_bsdf, density);
        ASSERT_TRUE(weight >= 0 && weight <= 1) << width << " " << i << " " << density;
      }
      // From beside it, below, the density is that of a finite solid angle.
      if (from.y == 0) {
        ASSERT_LT(density, std::numeric_limits<float>::infinity()) << width;
      }
    }
  }
  EXPECT_GT(hits, 1'000) << "too few rays hit for a meaningful test";
}

/// Triangles of all sizes, half of them double-sided, some thin or tiny, in a box 20 m wide.
Scene many_lamps(int count, Dice& dice) {
  Scene scene = empty_scene();
  const auto one_sided = add_material(&scene, lamp(1));
  Material both = lamp(3);
  both.double_sided = true;
  const auto two_sided = add_material(&scene, both);
  for (int i = 0; i < count; ++i) {
    const float size = std::pow(10.0f, 1 - 4 * dice.unit());
    const Vec3f at = dice.vector() * 10.0f;
    const Vec3f thin = i % 5 == 0 ? Vec3f{1, 1e-4f, 1} : Vec3f{1, 1, 1};
    const auto corner = [&] {
      const Vec3f v = dice.vector() * size;
      return at + Vec3f{v.x * thin.x, v.y * thin.y, v.z * thin.z};
    };
    std::array<Vec3f, 3> corners;
    for (Vec3f& c : corners) c = corner();
    add_primitive(&scene, triangle(corners, i % 2 == 0 ? one_sided : two_sided),
                  i % 3 == 0 ? scaling(-1, 1, 1) : render::Affine3d{});
  }
  return scene;
}

TEST(AreaLights, EveryLampThatLightsAPointIsSampled) {  // hard case 66
  constexpr int kLamps = 400, kPairs = 100'000;
  Dice dice(66);
  const Scene scene = many_lamps(kLamps, dice);
  const ShadingScene shading(scene);
  const LightSampler lights(scene, shading);
  int lit = 0;
  for (int i = 0; i < kPairs; ++i) {
    const render::TriangleId id{dice.below(kLamps), 0, 0};
    const float b1 = dice.unit(), b2 = (1 - b1) * dice.unit();
    auto point = render::surface_at(shading, id, b1, b2, {0, 0, -1});
    const Vec3d on_lamp(render::position_of(point).position);
    // Near lamps, far from all, and among them.
    const double reach = std::pow(10.0, 6 * static_cast<double>(dice.unit()) - 3);
    const LightSampleContext context{Vec3f(on_lamp + Vec3d(dice.direction()) * reach),
                                     dice.direction(), dice.below(4) == 0};
    const Vec3d between = Vec3d(context.point) - on_lamp;
    const double distance = length(between);
    if (!(distance > 0)) continue;
    const Vec3f out(between / distance);
    const float cos_receiver = -dot(out, context.normal);
    if (!context.every_side && !(cos_receiver > 0)) continue;
    point = render::surface_at(shading, id, b1, b2, -out);
    const Vec3f radiance = render::emission_at(shading, point, out);
    if (!(render::max_component(radiance) > 0)) continue;
    ++lit;
    const float cosine = std::fabs(dot(out, point.geometric_normal));
    const float density = lights.emitter_pdf(context, id, static_cast<float>(distance), cosine);
    ASSERT_GT(density, 0) << "pair " << i << ", lamp " << id.instance << ", at " << distance;
  }
  EXPECT_GT(lit, kPairs / 4) << "too few lamps give light for a meaningful test";
}

}  // namespace
}  // namespace tessera::testing
