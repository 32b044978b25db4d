// Hard cases 1, 2, 4, 13, 14: no ray leaks through shared edges, vertices or planes.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "worker/accel/reference/brute_force.h"

namespace tessera::render::testing {
namespace {

/// Counts rays from inside a closed surface towards its edges or vertices that miss it, in the tree
/// of either width.
int leaks(const Scene& scene, const Primitive& primitive, bool edge, const Vec3f& centre,
          float spread, int rays, std::uint32_t seed) {
  std::vector<SceneAccel> accels;
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (is_supported(isa)) accels.emplace_back(scene, in_order(), isa);
  }
  const Affine3d& to_world = scene.instances[0].object_to_world;
  Dice dice(seed);
  int missed = 0;
  for (int i = 0; i < rays; ++i) {
    const Vec3d target(edge_or_vertex(primitive, edge, dice));
    const Vec3d origin = Vec3d(centre) + Vec3d(dice.direction()) * static_cast<double>(spread);
    Ray ray;
    ray.origin = Vec3f(transform_point(to_world, origin));
    ray.direction = Vec3f(transform_point(to_world, target)) - ray.origin;
    for (const SceneAccel& accel : accels) {
      Hit hit;
      if (!accel.closest_hit(ray, hit)) ++missed;
    }
  }
  return missed;
}

TEST(Watertight, SharedEdgesDoNotLeak) {
  const Primitive sphere = uv_sphere(16, 32, 2);
  ASSERT_EQ(sphere.triangles.size(), 960u);
  EXPECT_EQ(leaks(scene_of({sphere}), sphere, true, {}, 1.5f, 60'000, 1), 0);
}

TEST(Watertight, SharedVerticesDoNotLeak) {
  const Primitive sphere = uv_sphere(16, 32, 2);
  EXPECT_EQ(leaks(scene_of({sphere}), sphere, false, {}, 1.5f, 60'000, 2), 0);
}

TEST(Watertight, FarFromOriginDoesNotLeak) {
  const Vec3f centre = {148376, 1234, -223423};
  const Primitive sphere = uv_sphere(16, 32, 2, centre);
  EXPECT_EQ(leaks(scene_of({sphere}), sphere, true, centre, 1, 30'000, 3), 0);
  EXPECT_EQ(leaks(scene_of({sphere}), sphere, false, centre, 1, 30'000, 4), 0);
}

TEST(Watertight, TransformedSpheresDoNotLeak) {
  const Primitive sphere = uv_sphere(16, 32, 2);
  Dice dice(5);
  for (const double scale : {1e-6, 1e-3, 1.0, 1e3, 1e6}) {
    for (const bool mirrored : {false, true}) {
      Scene scene;
      scene.meshes.push_back(mesh_of({sphere}));
      place(scene, 0, random_placement(dice, scale, Vec3d{1, -2, 3} * scale, mirrored));
      EXPECT_EQ(leaks(scene, sphere, true, {}, 1.5f, 10'000, 6), 0) << scale;
      EXPECT_EQ(leaks(scene, sphere, false, {}, 1.5f, 10'000, 7), 0) << scale;
    }
  }
}

TEST(Watertight, LongEdgesDoNotLeak) {
  // Two strips of floor share an edge along x that lies in a face of both boxes and whose ends are
  // far away. The ray's shear along the edge rounds with the distance of the ends, the box test
  // only with that of the hit. Without the slack of enter_leave(), for rays just off the edge, the
  // triangle chosen by the edge function would be rejected by its own box, and its neighbour by the
  // edge function.
  const Primitive floor = [] {
    Primitive p;
    for (int z = -1; z <= 1; ++z) {
      p.positions.push_back({-7e3f, 0, 1e4f * static_cast<float>(z)});
      p.positions.push_back({9e3f, 0, 1e4f * static_cast<float>(z)});
    }
    p.triangles = {{0, 1, 3}, {0, 3, 2}, {2, 3, 5}, {2, 5, 4}};
    return p;
  }();
  const SceneAccel accel(scene_of({floor}), in_order());
  Dice dice(9);
  int missed = 0;
  for (int i = 0; i < 200'000; ++i) {
    Ray ray;
    ray.origin = {dice.both(), std::exp2(-8 * dice.unit()), dice.both()};
    const Vec3f target = {std::exp2(10 * dice.unit()), 0, 2e-5f * dice.both()};
    ray.direction = target - ray.origin;
    Hit hit;
    if (!accel.closest_hit(ray, hit)) ++missed;
  }
  EXPECT_EQ(missed, 0);
}

TEST(TriangleTest, MicroTrianglesAndNeedlesAreHit) {
  for (const float s : {1e-5f, 1e-6f, 1e-7f, 1e-8f, 1e-9f, 1e-10f, 1e-12f}) {
    Primitive p;
    p.positions = {{0, 0, 0}, {s, 0, 0}, {0, s, 0}};
    p.triangles = {{0, 1, 2}};
    const SceneAccel accel(scene_of({p}), in_order());
    Ray ray;
    ray.origin = {s / 3, s / 3, -1};
    ray.direction = {0, 0, 1};
    Hit hit;
    EXPECT_TRUE(accel.closest_hit(ray, hit)) << s;
    EXPECT_EQ(hit.t, 1) << s;
  }
  Primitive needle;
  needle.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1e-7f, 0}};
  needle.triangles = {{0, 1, 2}};
  const SceneAccel accel(scene_of({needle}), in_order());
  Ray ray;
  ray.origin = {0.5f, 2e-8f, 1};
  ray.direction = {0, 0, -1};
  Hit hit;
  EXPECT_TRUE(accel.closest_hit(ray, hit));
}

TEST(TriangleTest, DegenerateTrianglesAreNeverHit) {
  Primitive p;
  p.positions = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {1, 1, 1}};
  p.triangles = {{0, 1, 2}, {0, 0, 1}, {3, 3, 3}, {1, 2, 1}, {0, 2, 0}};
  const SceneAccel accel(scene_of({p}), in_order());
  Dice dice(10);
  for (int i = 0; i < 20'000; ++i) {
    Ray ray;
    ray.origin = dice.vector() * 3.0f;
    ray.direction = edge_or_vertex(p, i % 2 == 0, dice) - ray.origin;
    Hit hit;
    ASSERT_FALSE(accel.closest_hit(ray, hit)) << i;
  }
  Ray down;
  down.origin = {1, 1, 0};
  down.direction = {0, -1, 0};
  EXPECT_FALSE(accel.any_hit(down));
}

TEST(SlabTest, ZeroDirectionHitsTouchedBoxes) {
  ObjectRay ray;
  const Box3f scene = {{-2, -2, -2}, {2, 2, 2}};
  for (const float x : {0.0f, 1.0f}) {
    for (const float zero : {0.0f, -0.0f}) {
      ASSERT_TRUE(make_object_ray({x, 0.5f, -2}, {zero, 0, 1}, scene, ray));
      const EnterLeave unit = enter_leave(ray, {0, 0, 0}, {1, 1, 1});
      EXPECT_LE(unit.enter, unit.leave);
      EXPECT_EQ(unit.enter, 2);
      const EnterLeave beside = enter_leave(ray, {1.5f, 0, 0}, {2, 1, 1});
      const bool met =
          beside.enter <= beside.leave && beside.enter <= std::numeric_limits<float>::max();
      EXPECT_FALSE(met);
    }
  }
}

TEST(SlabTest, RaysInSplitPlanesFindNoHole) {
  const Primitive left = quad({-1, -1, 0}, {1, 0, 0}, {0, 2, 0});
  const Primitive right = quad({0, -1, 0}, {1, 0, 0}, {0, 2, 0});
  const SceneAccel accel(scene_of({left, right}), in_order());
  for (int i = 0; i < 4096; ++i) {
    Ray ray;
    ray.origin = {0, -1 + 2 * (static_cast<float>(i) + 0.5f) / 4096, -2};
    ray.direction = {i % 2 == 0 ? 0.0f : -0.0f, 0, 1};
    Hit hit;
    ASSERT_TRUE(accel.closest_hit(ray, hit)) << i;
    ASSERT_EQ(hit.t, 2);
  }
}

TEST(SlabTest, OriginsOnPlanesHitFlatBoxes) {
  ObjectRay ray;
  const Box3f bounds = {{0, 0, 0}, {1, 1, 1}};
  ASSERT_TRUE(make_object_ray({0.5f, 0.5f, 0}, {0, 0, 1}, bounds, ray));
  const EnterLeave cube = enter_leave(ray, {0, 0, 0}, {1, 1, 1});
  EXPECT_TRUE(cube.enter <= cube.leave && cube.leave >= 0);
  ASSERT_TRUE(make_object_ray({-1, 0.5f, 0.5f}, {1, 0, 0}, bounds, ray));
  const EnterLeave flat = enter_leave(ray, {0, 0, 0}, {0, 1, 1});
  EXPECT_TRUE(flat.enter <= flat.leave);
  EXPECT_EQ(flat.enter, 1);
}

TEST(SlabTest, BoxFacesAreHitFromInside) {
  const std::vector<Primitive> faces = {
      quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), quad({0, 0, 1}, {1, 0, 0}, {0, 1, 0}),
      quad({0, 0, 0}, {0, 1, 0}, {0, 0, 1}), quad({1, 0, 0}, {0, 1, 0}, {0, 0, 1}),
      quad({0, 0, 0}, {1, 0, 0}, {0, 0, 1}), quad({0, 1, 0}, {1, 0, 0}, {0, 0, 1})};
  const SceneAccel accel(scene_of(faces), in_order());
  const std::array<Vec3f, 6> directions = {Vec3f{0, 0, -1}, Vec3f{0, 0, 1},  Vec3f{-1, 0, 0},
                                           Vec3f{1, 0, 0},  Vec3f{0, -1, 0}, Vec3f{0, 1, 0}};
  for (std::uint32_t face = 0; face < 6; ++face) {
    for (const float y : {0.25f, 0.5f, 0.9f}) {
      Ray ray;
      ray.origin = {0.5f, y, 0.5f};
      ray.direction = directions[face];
      Hit hit;
      ASSERT_TRUE(accel.closest_hit(ray, hit));
      EXPECT_EQ(hit.id.primitive, face);
    }
  }
}

}  // namespace
}  // namespace tessera::render::testing
