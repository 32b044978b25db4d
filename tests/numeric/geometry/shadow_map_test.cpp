// A shadow map answers only what SceneAccel answers as well.

#include "worker/accelerators/shadow_map.h"

#include <gtest/gtest.h>

#include "tests/numeric/geometry/geometry_scenes.h"

namespace tessera::render::testing {
namespace {

void add_light(Scene& scene, const Vec3d& at) {
  PunctualLight light;
  light.position = at;
  scene.lights.push_back(light);
  scene.bounds_min = {-9, -9, -9};
  scene.bounds_max = {9, 9, 9};
}

void add_sun(Scene& scene, const Vec3f& direction) {
  add_light(scene, {0, 0, 0});
  scene.lights.back().kind = PunctualLight::Kind::directional;
  scene.lights.back().direction = normalize(direction);
}

struct Counts {
  int visible = 0, occluded = 0, unknown = 0, wrong = 0;
};

void add_answer(ShadowMap::Answer answer, bool blocked, Counts& counts) {
  switch (answer) {
    case ShadowMap::Answer::visible:
      ++counts.visible;
      counts.wrong += blocked ? 1 : 0;
      break;
    case ShadowMap::Answer::occluded:
      ++counts.occluded;
      counts.wrong += blocked ? 0 : 1;
      break;
    case ShadowMap::Answer::unknown:
      ++counts.unknown;
  }
}

/// Traces rays from points of the scene's triangles, and from the space between them, to a light.
Counts compare(const Scene& scene, int rays) {
  const ShadowMap map(scene);
  const SceneAccel accel(scene, sequential());
  Dice dice(21);
  Counts counts;
  for (int i = 0; i < rays; ++i) {
    const PunctualLight& light =
        scene.lights[dice.below(static_cast<std::uint32_t>(scene.lights.size()))];
    const bool sun = light.kind == PunctualLight::Kind::directional;
    Ray ray{dice.vector() * 4.0f, {}};
    Hit hit;
    Ray probe{Vec3f(light.position), dice.vector()};
    if (sun) probe = {dice.vector() * 4.0f - light.direction * 20.0f, light.direction};
    if (i % 2 == 0 && accel.closest_hit(probe, hit)) {  // the surface that the light sees
      ray.origin = probe.origin + probe.direction * hit.t;
      ray.origin_triangle = hit.id;
    }
    ray.direction = sun ? -light.direction : probe.origin - ray.origin;
    if (!sun) ray.t_max = 0.9999f;
    add_answer(map.answer(ray), accel.any_hit(ray), counts);
  }
  return counts;
}

TEST(ShadowMap, CertainAnswersAreThoseOfTracing) {
  Dice dice(20);
  Scene scene = scene_of({soup(60, dice), quad({-8, -8, -2}, {16, 0, 0}, {0, 16, 0}),
                          quad({-1, -1, 1}, {2, 0, 0}, {0, 2, 0})});
  add_light(scene, {0.3, 0.2, 5});
  add_light(scene, {-4, 1, 0.5});
  const Counts counts = compare(scene, 40'000);
  EXPECT_EQ(counts.wrong, 0);
  EXPECT_GT(counts.visible, 4'000);
  EXPECT_GT(counts.occluded, 2'000);
}

TEST(ShadowMap, TurnedInstancesAgree) {
  Dice dice(22);
  Scene scene;
  scene.meshes = {mesh_of({uv_sphere(4, 6, 1), quad({-2, -2, -2}, {4, 0, 0}, {0, 4, 0})})};
  for (int i = 0; i < 6; ++i) {
    place(scene, 0,
          random_placement(dice, 0.5 + 0.5 * dice.unit(), Vec3d(dice.vector() * 3.0f), i % 2 == 0));
  }
  add_light(scene, {0, 0, 0});
  add_light(scene, {0, 7, 1});
  const Counts counts = compare(scene, 40'000);
  EXPECT_EQ(counts.wrong, 0);
  EXPECT_GT(counts.visible + counts.occluded, 4'000);
}

TEST(ShadowMap, SunsAgree) {
  Dice dice(23);
  Scene scene = scene_of({soup(60, dice), quad({-8, -8, -2}, {16, 0, 0}, {0, 16, 0}),
                          quad({-1, -1, 1}, {2, 0, 0}, {0, 2, 0})});
  for (int i = 0; i < 3; ++i) {
    place(scene, 0, random_placement(dice, 0.1, Vec3d(dice.vector() * 4.0f), i == 0));
  }
  add_sun(scene, {0, 0, -1});
  add_sun(scene, {0.5f, -0.25f, -1});
  const Counts counts = compare(scene, 40'000);
  EXPECT_EQ(counts.wrong, 0);
  EXPECT_GT(counts.visible, 4'000);
  EXPECT_GT(counts.occluded, 2'000);
}

/// The edge of the square, at depth 1, is close to the border between two texels, and the rays,
/// from depth 8, end beside the light. Such a ray can meet the square although the line from its
/// origin to the light passes it by, and the other way round.
TEST(ShadowMap, RaysBesideTheLightAgree) {
  Dice dice(24);
  int others = 0;  // rays that differ from the line to the light
  for (const bool turned : {false, true}) {
    for (const float edge : {-0x1p-12f, 0x1p-12f}) {
      const auto at = [turned](float u, float v, float depth) {
        return turned ? Vec3f{v, u, depth} : Vec3f{u, v, depth};
      };
      Scene scene = scene_of({quad(at(edge, -1, 1), at(1, 0, 0), at(0, 2, 0))});
      add_light(scene, {0, 0, 0});
      const ShadowMap map(scene);
      const SceneAccel accel(scene, sequential());
      Counts counts;
      for (int i = 0; i < 4'000; ++i) {
        // Less than the 2^-10 of its length by which a ray may miss the light.
        const float off = 0x1.8p-11f * 8 * dice.both();
        const float u = 0.05f * dice.both(), v = 4 * dice.both();
        Ray ray{at(u, v, 8), {}};
        ray.direction = at(off, 0, 0) - ray.origin;
        ray.t_max = 1;
        const bool blocked = accel.any_hit(ray);
        add_answer(map.answer(ray), blocked, counts);
        others += blocked != (u > 8 * edge) ? 1 : 0;
      }
      EXPECT_EQ(counts.wrong, 0) << "edge at " << edge;
    }
  }
  EXPECT_GT(others, 2'000);
}

TEST(ShadowMap, LightOnATriangleDecidesNothing) {
  Scene scene = scene_of({quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0})});
  add_light(scene, {0.25, 0.125, 0});
  const Counts counts = compare(scene, 1'000);
  EXPECT_EQ(counts.visible + counts.occluded, 0);
}

}  // namespace
}  // namespace tessera::render::testing
