/// Moving lamps: the density of their samples.

#include "worker/light/emitters/moving_lights.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/numeric/motion/moving_scenes.h"
#include "worker/light/emitters/shape_light.h"
#include "worker/light/light_sampler.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render::testing {
namespace {

/// A scene in which everything emits to both sides.
Scene shining_scene(Dice& dice) {
  Scene scene = moving_scene(dice);
  Material material;
  material.emission = {1, 1, 1};
  material.double_sided = true;
  scene.materials.push_back(material);
  return scene;
}

LightSampleContext somewhere(Dice& dice) {
  return {dice.vector() * 2.0f, dice.direction(), true, dice.unit()};
}

bool lies_in(const LightBounds& bounds, const Vec3d& p) {
  constexpr double kSlack = 1e-12;  // rounding of numbers of about 1
  for (int k = 0; k < 3; ++k) {
    if (!(p[k] >= bounds.box_min[k] - kSlack && p[k] <= bounds.box_max[k] + kSlack)) return false;
  }
  return true;
}

double cosine_at(const ShadingScene& shading, const Hit& hit, const Ray& ray) {
  MovedSurface memory;
  const ShadingPoint p = surface_at(shading, hit, ray.direction, ray.time, memory);
  return std::fabs(static_cast<double>(dot(p.geometric_normal, ray.direction)));
}

TEST(MovingLights, SamplesMatchHitDensity) {
  Dice dice(41);
  const Scene scene = shining_scene(dice);
  const ShadingScene shading(scene);
  const LightSampler lights(scene, shading);
  int compared = 0, moving = 0;
  for (int i = 0; i < 4'000; ++i) {
    const LightSampleContext receiver = somewhere(dice);
    const LightRandom u = {static_cast<double>(dice.unit()), static_cast<double>(dice.unit()),
                           static_cast<double>(dice.unit())};
    LightSample sample;
    if (!lights.sample(receiver, u, &sample)) continue;
    Ray ray;
    ray.origin = receiver.point;
    ray.direction = sample.direction;
    ray.time = receiver.time;
    const float distance = length(sample.target - receiver.point);
    for (const Hit& hit : all_hits(scene, ray)) {
      if (hit.id != sample.triangle || std::fabs(hit.t - distance) > 1e-4f * distance) continue;
      const double cosine = cosine_at(shading, hit, ray);
      if (cosine < 0.01) continue;  // where the rounding of a float is a large part of it
      const float pdf = lights.emitter_pdf(receiver, hit.id, hit.t, static_cast<float>(cosine));
      EXPECT_NEAR(pdf / sample.pdf, 1, 2e-3) << hit.id.instance << " " << hit.id.triangle;
      ++compared;
      moving += shading.instances[hit.id.instance].moves ? 1 : 0;
    }
  }
  EXPECT_GT(compared, 2'000);
  EXPECT_GT(moving, 1'000);
}

TEST(MovingLights, DensityIsPositiveWhereHit) {
  Dice dice(42);
  const Scene scene = shining_scene(dice);
  const ShadingScene shading(scene);
  const LightSampler lights(scene, shading);
  int met = 0;
  for (int i = 0; i < 20'000; ++i) {
    const LightSampleContext receiver = somewhere(dice);
    Ray ray;
    ray.origin = receiver.point;
    ray.direction = dice.direction();
    ray.time = receiver.time;
    Hit hit;
    if (!brute_force_closest(scene, ray, hit)) continue;
    if (scene.instances[hit.id.instance].operand || !shading.instances[hit.id.instance].moves) {
      continue;
    }
    const double cosine = cosine_at(shading, hit, ray);
    EXPECT_GT(lights.emitter_pdf(receiver, hit.id, hit.t, static_cast<float>(cosine)), 0);
    ++met;
  }
  EXPECT_GT(met, 1'000);
}

TEST(MovingLights, TrianglesLieWithinBounds) {
  Dice dice(43);
  const Scene scene = shining_scene(dice);
  int outside_of_ends = 0;
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(scene.instances[i].mesh)];
    if (mesh.shape != nullptr || (scene.instances[i].motion == kNone && mesh.keys.empty()))
      continue;
    for (std::uint32_t t = 0; t < mesh.primitives[0].triangles.size(); ++t) {
      const TriangleId id = {i, 0, t};
      const LightBounds bounds = bounds_of_moving(scene, id);
      std::vector<LightBounds> ends;
      for (const float time : scene.key_times) {
        ends.push_back(bounds_of(*corners_of(scene, id, time), false));
      }
      for (int k = 0; k < 50; ++k) {
        const auto corners = corners_of(scene, id, dice.unit());
        if (!corners) continue;
        for (const Vec3d& corner : *corners) {
          ASSERT_TRUE(lies_in(bounds, corner)) << i << " " << t;
          outside_of_ends += lies_in(bounds_over(ends), corner) ? 0 : 1;
        }
      }
    }
  }
  EXPECT_GT(outside_of_ends, 0) << "no path bends: the test has lost its subject";
}

TEST(MovingLights, ShapesLieWithinBounds) {
  Dice dice(44);
  const Scene scene = shining_scene(dice);
  int met = 0, outside_at_first = 0;
  for (const Instance& instance : scene.instances) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    if (mesh.shape == nullptr || instance.motion == kNone) continue;
    const LightBounds bounds = bounds_of_moving(scene, instance, 1, true);
    const Affine3d& first = scene.motions[static_cast<std::size_t>(instance.motion)][0];
    const LightBounds before = ShapeLight(first, *inverse(first), *mesh.shape).bounds(1, true);
    for (int i = 0; i < 2'000; ++i) {
      const auto pose = pose_of(scene, instance, dice.unit());
      if (!pose) continue;
      const ShapeLight emitter(pose->object_to_world, pose->world_to_object, *mesh.shape);
      const Vec3d from = Vec3d(dice.vector()) * 3.0;
      if (!(emitter.solid_angle(from) > 0)) continue;
      const Vec3d direction =
          emitter.sample(from, static_cast<double>(dice.unit()), static_cast<double>(dice.unit()));
      ShapeHit hit;
      if (!emitter.find(from, direction, hit)) continue;
      const Vec3d point = from + direction * hit.t;
      ASSERT_TRUE(lies_in(bounds, point)) << mesh.name;
      ++met;
      outside_at_first += lies_in(before, point) ? 0 : 1;
    }
  }
  EXPECT_GT(met, 1'000);
  EXPECT_GT(outside_at_first, 100);
}

}  // namespace
}  // namespace tessera::render::testing
