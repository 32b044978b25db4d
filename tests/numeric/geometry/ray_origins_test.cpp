// Hard cases 8, 9, 10, 27, 49: spawned rays and shading frames.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "worker/accel/reference/brute_force.h"
#include "worker/geometry/frame.h"
#include "worker/geometry/surface_point.h"

namespace tessera::render::testing {
namespace {

PlacedTriangle placed(const Scene& scene, const TriangleId& id) {
  const Instance& instance = scene.instances[id.instance];
  const Primitive& primitive =
      scene.meshes[static_cast<std::size_t>(instance.mesh)].primitives[id.primitive];
  const auto& triangle = primitive.triangles[id.triangle];
  return {instance.object_to_world, instance.world_to_object, primitive.positions[triangle[0]],
          primitive.positions[triangle[1]], primitive.positions[triangle[2]]};
}

SurfacePoint point_of(const Scene& scene, const Hit& hit) {
  return surface_point(placed(scene, hit.id), hit.b1, hit.b2);
}

TEST(RaySpawning, CoplanarTwinIsNotHit) {
  Dice dice(1);
  const Affine3d identity;
  int self_hits = 0, trials = 0;
  float largest_shift = 0;
  for (int i = 0; i < 150'000; ++i) {
    const float size = std::pow(10.0f, static_cast<float>(3 * (i % 6) - 6));
    const std::array<float, 3> offsets = {0, 1e3f, 1e6f};
    const float offset = offsets[static_cast<std::size_t>(i / 6 % 3)];
    const Vec3f base = dice.direction() * offset;
    const std::array<Vec3f, 3> v = {base + dice.vector() * size, base + dice.vector() * size,
                                    base + dice.vector() * size};
    if (!is_hittable(v[0], v[1], v[2])) continue;
    const Vec2f u = {dice.unit(), dice.unit()};
    const bool fold = u.x + u.y > 1;
    const SurfacePoint point = surface_point({identity, identity, v[0], v[1], v[2]},
                                             fold ? 1 - u.x : u.x, fold ? 1 - u.y : u.y);
    const Vec3f direction = dice.direction();
    const Ray ray = spawn_ray(point, {0, 0, 0}, direction);
    // The twin has another vertex order and its own id, so skipping ids does not help.
    Box3f bounds;
    for (const Vec3f& p : v) bounds.extend(p);
    ObjectRay object_ray;
    ASSERT_TRUE(make_object_ray(ray.origin, ray.direction, bounds, object_ray));
    TriangleHit hit{};
    if (intersect_triangle(object_ray, v[1], v[2], v[0], hit) && hit.t >= 0) ++self_hits;
    ++trials;
    const float extent = 2 * size;  // corners are drawn from a cube of that side
    const float shift = length(ray.origin - point.position) / extent;
    if (offset == 0 && shift > largest_shift) largest_shift = shift;
  }
  EXPECT_GT(trials, 120'000);
  EXPECT_EQ(self_hits, 0);
  EXPECT_LE(largest_shift, 1e-6f);
}

TEST(RaySpawning, TiltedPlaneNeighboursAreNotHit) {
  // A finely divided plane under random placements: a ray that leaves it must not hit any part of
  // it.
  Dice dice(2);
  Primitive plane;
  constexpr std::uint32_t kSide = 16;
  for (std::uint32_t y = 0; y <= kSide; ++y) {
    for (std::uint32_t x = 0; x <= kSide; ++x) {
      plane.positions.push_back({static_cast<float>(x) / 8 - 1, static_cast<float>(y) / 8 - 1, 0});
    }
  }
  for (std::uint32_t y = 0; y < kSide; ++y) {
    for (std::uint32_t x = 0; x < kSide; ++x) {
      const std::uint32_t a = y * (kSide + 1) + x, b = a + kSide + 1;
      plane.triangles.push_back({a, a + 1, b + 1});
      plane.triangles.push_back({a, b + 1, b});
    }
  }
  int again = 0, hits = 0;
  for (int placement = 0; placement < 40; ++placement) {
    const double scale = std::exp2(placement % 5 * 10 - 20);
    Scene scene;
    scene.meshes.push_back(mesh_of({plane}));
    place(scene, 0,
          random_placement(dice, scale, Vec3d(dice.vector()) * (placement % 3 * scale), false));
    const SceneAccel accel(scene, in_order());
    for (int i = 0; i < 2'000; ++i) {
      const Vec3d target = {dice.both(), dice.both(), 0};
      Ray ray;
      ray.origin = Vec3f(
          transform_point(scene.instances[0].object_to_world, Vec3d{dice.both(), dice.both(), 1}));
      ray.direction =
          Vec3f(transform_point(scene.instances[0].object_to_world, target)) - ray.origin;
      Hit hit;
      if (!accel.closest_hit(ray, hit)) continue;
      ++hits;
      const Vec3f out = dice.direction();
      if (accel.closest_hit(spawn_ray(point_of(scene, hit), hit.id, out), hit)) ++again;
    }
  }
  EXPECT_GT(hits, 70'000);
  EXPECT_EQ(again, 0);
}

/// Returns 8 x 8 exactly coplanar parallelograms with integer edges `a` and `b`, two triangles
/// each, beginning at `corner`, all multiplied by `scale`.
Primitive lattice(const Vec3f& a, const Vec3f& b, const Vec3f& corner, float scale) {
  constexpr std::uint32_t kSide = 8;
  Primitive plane;
  for (std::uint32_t y = 0; y <= kSide; ++y) {
    for (std::uint32_t x = 0; x <= kSide; ++x) {
      const Vec3f p = corner + a * static_cast<float>(x) + b * static_cast<float>(y);
      plane.positions.push_back(p * scale);
    }
  }
  add_grid_triangles(plane, kSide);
  return plane;
}

/// Returns a direction on either side of the plane with normal `n`: arbitrary, grazing, or in a
/// coordinate plane.
Vec3f departure(const Vec3f& n, Dice& dice) {
  Vec3f d = dice.direction();
  if (dice.below(2) == 0) {
    const float elevation = std::pow(10.0f, -7 * dice.unit());
    d = d - n * (dot(d, n) + (dice.below(2) == 0 ? elevation : -elevation));
  }
  if (dice.below(4) == 0) d[static_cast<int>(dice.below(3))] = 0;
  return d;
}

TEST(RaySpawning, CoplanarNeighboursAreNotHit) {
  // Planes with and without extent along the axes; as many points on shared edges and vertices as
  // inside. A needle's neighbour is hit along its length, far from where its plane is thin.
  const std::vector<std::array<Vec3f, 2>> edges = {
      {{{1, 0, 0}, {0, 1, 0}}},   {{{0, 0, 1}, {1, 0, 0}}},   {{{1, 0, 0}, {0, 1, 1}}},
      {{{2, -1, 0}, {0, 1, -1}}}, {{{64, 0, 1}, {0, 1, 0}}},  {{{1, 0, 0}, {0, 1, -7}}},
      {{{100, 0, 0}, {0, 1, 1}}}, {{{100, 3, -3}, {0, 1, 1}}}};
  Dice dice(8);
  int again = 0;
  float largest_shift = 0;
  for (std::size_t i = 0; i < edges.size() * 6; ++i) {
    const auto& [a, b] = edges[i / 6];
    const float scale = std::exp2(static_cast<float>(i % 3) * 12 - 12);
    const Vec3f far = {static_cast<float>(dice.below(1000)), static_cast<float>(dice.below(1000)),
                       static_cast<float>(dice.below(1000))};
    const Primitive plane = lattice(a, b, i % 2 == 0 ? Vec3f{} : far, scale);
    const Scene scene = scene_of({plane});
    const SceneAccel accel(scene, in_order());
    for (int k = 0; k < 4'000; ++k) {
      const TriangleId id = {0, 0, dice.below(static_cast<std::uint32_t>(plane.triangles.size()))};
      float b1 = dice.unit(), b2 = (1 - b1) * dice.unit();
      const std::uint32_t where = dice.below(6);
      if (where == 0 || where == 3) b1 = 0;
      if (where == 1 || where == 3) b2 = 0;
      if (where == 2) b2 = 1 - b1;
      const SurfacePoint point = surface_point(placed(scene, id), b1, b2);
      const Vec3f out = departure(point.normal, dice);
      const Ray ray = spawn_ray(point, id, out);
      Hit hit;
      if (accel.closest_hit(ray, hit)) ++again;
      const float reach = max_abs(point.position) + scale * (max_abs(a) + max_abs(b));
      const float shift = length(ray.origin - point.position) / reach;
      if (shift > largest_shift) largest_shift = shift;
    }
  }
  EXPECT_EQ(again, 0);
  // Three axes, u = 2^-24: 8 u of the extent (2 and 6) and 3 u of the position, and a float's step.
  EXPECT_LT(largest_shift, 3 * 12 * 0x1p-24f);
}

TEST(RaySpawning, AxisAlignedTwinIsNotHit) {
  // The plane's coordinate is exact, even zero: the ray must overcome only the rounding of t.
  const Primitive sheet = quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0});
  const Scene scene = scene_of({sheet, sheet});
  const SceneAccel accel(scene, in_order());
  Dice dice(9);
  for (int i = 0; i < 50'000; ++i) {
    const TriangleId id = {0, dice.below(2), dice.below(2)};
    const float b1 = dice.unit();
    const SurfacePoint point = surface_point(placed(scene, id), b1, (1 - b1) * dice.unit());
    Hit hit;
    ASSERT_FALSE(accel.closest_hit(spawn_ray(point, id, departure(point.normal, dice)), hit)) << i;
  }
}

TEST(RaySpawning, GrazingBouncesLeavePlane) {
  // A plane of 1e4 by 1e4 and a wall one unit behind it.
  Scene scene = scene_of({quad({-5e3f, 0, -5e3f}, {1e4f, 0, 0}, {0, 0, 1e4f}),
                          quad({-5e3f, -1, -5e3f}, {1e4f, 0, 0}, {0, 0, 1e4f})});
  const SceneAccel accel(scene, in_order());
  Dice dice(3);
  int hits = 0;
  for (int i = 0; i < 50'000; ++i) {
    const float elevation = std::pow(10.0f, -3 - 3 * dice.unit());
    const Vec3f target = {4e3f * dice.both(), 0, 4e3f * dice.both()};
    const Vec3f along = normalize(Vec3f{dice.both(), 0, dice.both()});
    Ray ray;
    ray.direction = along - Vec3f{0, elevation, 0};
    ray.origin = target - ray.direction * (100 * dice.unit());
    ray.origin.y = std::fabs(ray.origin.y);
    Hit hit;
    if (!accel.closest_hit(ray, hit)) continue;
    ASSERT_EQ(hit.id.primitive, 0u) << "the plane must hide the wall behind it";
    ++hits;
    const Vec3f reflected = {ray.direction.x, elevation, ray.direction.z};
    Hit next;
    ASSERT_FALSE(accel.closest_hit(spawn_ray(point_of(scene, hit), hit.id, reflected), next)) << i;
  }
  EXPECT_GT(hits, 40'000);
}

TEST(RaySpawning, ThinWallsDoNotLeak) {
  // Two slanted sheets 1e-5 apart in a room of unit size, with a light behind the second one.
  Dice dice(4);
  for (int placement = 0; placement < 8; ++placement) {
    Scene scene;
    scene.meshes.push_back(mesh_of(
        {quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}), quad({-1, -1, -1e-5f}, {2, 0, 0}, {0, 2, 0})}));
    place(scene, 0, placement == 0 ? Affine3d{} : random_placement(dice, 1, {0, 0, 0}, false));
    const Affine3d& to_world = scene.instances[0].object_to_world;
    const SceneAccel accel(scene, in_order());
    for (int i = 0; i < 20'000; ++i) {
      const TriangleId id = {0, 0, dice.below(2)};
      const Vec2f u = {dice.unit(), dice.unit()};
      const bool fold = u.x + u.y > 1;
      const SurfacePoint point =
          surface_point(placed(scene, id), fold ? 1 - u.x : u.x, fold ? 1 - u.y : u.y);
      const Vec3f light(
          transform_point(to_world, Vec3d{0.4 * dice.both(), 0.4 * dice.both(), -0.5}));
      // The first sheet's back faces the light; only the second sheet hides it.
      ASSERT_TRUE(accel.any_hit(spawn_ray_to(point, id, light)));
      // Nothing is in front of the first sheet.
      const Vec3f front(transform_vector(to_world, Vec3d{dice.both(), dice.both(), 0.01}));
      ASSERT_FALSE(accel.any_hit(spawn_ray(point, id, front)));
    }
  }
}

TEST(RaySpawning, ShadowRaysReachTheirTargets) {
  Dice dice(5);
  for (const float scale : {1e-6f, 1.0f, 1e9f}) {
    const Primitive room = uv_sphere(8, 12, scale);
    const Scene scene = scene_of({room});
    const SceneAccel accel(scene, in_order());
    for (int i = 0; i < 60'000; ++i) {
      const auto random_point = [&](TriangleId& id) {
        id = {0, 0, dice.below(static_cast<std::uint32_t>(room.triangles.size()))};
        return surface_point(placed(scene, id), 0.05f + 0.4f * dice.unit(),
                             0.05f + 0.4f * dice.unit());
      };
      TriangleId from_id, to_id;
      const SurfacePoint from = random_point(from_id);
      const SurfacePoint to = random_point(to_id);
      // The sphere is convex: all its points see each other, except those of one flat quad, whose
      // rays lie in its plane.
      const Vec3f between = normalize(to.position - from.position);
      if (std::fabs(dot(between, from.normal)) < 1e-5f) continue;
      ASSERT_FALSE(accel.any_hit(spawn_ray_to(from, from_id, to))) << scale << ' ' << i;
    }
  }
}

TEST(SurfaceNormals, PointOutwardsWhenMirrored) {
  Dice dice(6);
  const Primitive sphere = uv_sphere(8, 12, 1);
  for (const bool mirrored : {false, true}) {
    Scene scene;
    scene.meshes.push_back(mesh_of({sphere}));
    Affine3d m = random_placement(dice, 2, {3, -1, 4}, mirrored);
    for (Vec3d& row : m.rows) row.y *= 0.01;  // scaled as well: normals need the inverse transpose
    place(scene, 0, m);
    for (std::uint32_t t = 0; t < sphere.triangles.size(); ++t) {
      const PlacedTriangle triangle = placed(scene, {0, 0, t});
      const SurfacePoint point = surface_point(triangle, 0.3f, 0.3f);
      const Vec3d outwards = Vec3d(point.position) - m.translation;
      ASSERT_GT(dot(Vec3d(point.normal), outwards), 0);
      const auto corner = [&](const Vec3f& v) { return transform_point(m, Vec3d(v)); };
      const Vec3d exact = normalize(cross(corner(triangle.v1) - corner(triangle.v0),
                                          corner(triangle.v2) - corner(triangle.v0)));
      ASSERT_NEAR(std::fabs(dot(exact, Vec3d(point.normal))), 1, 1e-6);
      ASSERT_NEAR(length(point.normal), 1, 2e-7f);
    }
  }
}

TEST(ShadingFrame, IsOrthonormalNearMinusZ) {
  Dice dice(7);
  double worst = 0;
  const auto check = [&](const Vec3f& n) {
    const Frame f = Frame::from_normal(n);
    const Vec3d s(f.s), t(f.t), d(f.n);
    for (const double e :
         {dot(s, s) - 1, dot(t, t) - 1, dot(s, t), dot(s, d), dot(t, d), dot(cross(s, t), d) - 1}) {
      if (std::fabs(e) > worst) worst = std::fabs(e);
    }
  };
  for (int i = 0; i < 2'000'000; ++i) {
    const float tilt = std::pow(10.0f, -8 * dice.unit());
    const float x = tilt * dice.both(), y = tilt * dice.both();
    check(normalize(Vec3f{x, y, i % 8 == 0 ? 1.0f : -1.0f}));
  }
  for (const float z : {-1.0f, 1.0f}) check({0, 0, z});
  check({1, 0, -0.0f});
  check({0, 1, 0.0f});
  EXPECT_LE(worst, 0x1p-22);
}

}  // namespace
}  // namespace tessera::render::testing
