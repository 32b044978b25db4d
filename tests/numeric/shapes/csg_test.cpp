// Hard cases 21 and 22: CSG solids.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/numeric/shapes/solid_scenes.h"
#include "worker/accel/build/instance_boxes.h"

namespace tessera::render::testing {
namespace {

Shape unit_box() {
  return make_box({1, 1, 1});
}

/// [0,1]^3 with [0,1]^2 x [1,2], the latter moved by `shift` along z.
Scene stacked(CsgOperation operation, double shift) {
  Scene scene;
  place_shape(scene, unit_box(), moved({0.5, 0.5, 0.5}));
  place_shape(scene, unit_box(), moved({0.5, 0.5, 1.5 + shift}));
  combine(scene, operation);
  return scene;
}

std::vector<float> passages(const Scene& scene, const Vec3f& origin, const Vec3f& direction) {
  Ray ray;
  ray.origin = origin;
  ray.direction = direction;
  std::vector<float> ts;
  for (const Hit& hit : all_hits(scene, ray)) ts.push_back(hit.t);
  return ts;
}

TEST(Csg, CoincidentFacesLeaveNoFilm) {
  using Ts = std::vector<float>;
  const Vec3f from = {0.5f, 0.5f, -1}, up = {0, 0, 1};
  EXPECT_EQ(passages(stacked(CsgOperation::unite, 0), from, up), (Ts{1, 3}));
  EXPECT_EQ(passages(stacked(CsgOperation::subtract, 0), from, up), (Ts{1, 2}));
  EXPECT_EQ(passages(stacked(CsgOperation::intersect, 0), from, up), (Ts{}));
  EXPECT_EQ(passages(stacked(CsgOperation::exclude, 0), from, up), (Ts{1, 3}));
  // Along a face that both share: hits of a closed box.
  EXPECT_EQ(passages(stacked(CsgOperation::unite, 0), {0, 0.5f, -1}, up), (Ts{1, 3}));
}

TEST(Csg, OneUlpShiftSeparatesFaces) {
  // From z = 0.5, where t has enough precision: the faces are at t = 0.5 and 0.5 +- 2^-23.
  const Vec3f from = {0.5f, 0.5f, 0.5f}, up = {0, 0, 1};
  const double step = 0x1p-23;
  EXPECT_EQ(passages(stacked(CsgOperation::unite, -step), from, up).size(), 1u);
  EXPECT_EQ(passages(stacked(CsgOperation::unite, step), from, up).size(), 3u);
  EXPECT_EQ(passages(stacked(CsgOperation::intersect, -step), from, up).size(), 2u);
  EXPECT_EQ(passages(stacked(CsgOperation::intersect, step), from, up).size(), 0u);
  EXPECT_EQ(passages(stacked(CsgOperation::exclude, -step), from, up).size(), 3u);
  EXPECT_EQ(passages(stacked(CsgOperation::exclude, step), from, up).size(), 3u);
  for (const double shift : {-step, step}) {
    const std::vector<float> left = passages(stacked(CsgOperation::subtract, shift), from, up);
    ASSERT_EQ(left.size(), 1u) << shift;
    EXPECT_EQ(left[0], shift < 0 ? 0.5f - 0x1p-23f : 0.5f);
  }
}

TEST(Csg, RayMayStartInSubtractedOperand) {
  Scene scene;
  place_shape(scene, ball(1));
  place_shape(scene, ball(0.5));
  combine(scene, CsgOperation::subtract);
  Ray ray;
  ray.direction = {0, 0.6f, 0.8f};
  const std::vector<Hit> hits = all_hits(scene, ray);
  ASSERT_EQ(hits.size(), 2u);
  EXPECT_NEAR(hits[0].t, 0.5, 1e-7);
  EXPECT_EQ(hits[0].id.instance, 1u);            // material of the subtracted operand
  EXPECT_EQ(hits[0].id.triangle, kFlippedSide);  // the normal is reversed
  EXPECT_NEAR(hits[1].t, 1, 1e-7);
  EXPECT_EQ(hits[1].id.triangle, 0u);
}

TEST(Csg, RayMayStartInsideMesh) {
  Scene scene;
  scene.meshes.push_back(mesh_of({uv_sphere(8, 12, 1)}));
  place(scene, 0);
  place_shape(scene, ball(0.5), moved({0.1, 0.2, 0}));
  combine(scene, CsgOperation::subtract);
  Ray ray;
  ray.origin = {0, -0.6f, 0};
  ray.direction = {0, 1, 0};
  const std::vector<Hit> hits = all_hits(scene, ray);
  ASSERT_EQ(hits.size(), 3u);  // into the hole, out of it, out of the mesh
  EXPECT_EQ(hits[0].id.instance, 1u);
  EXPECT_EQ(hits[1].id.instance, 1u);
  EXPECT_EQ(hits[2].id.instance, 0u);
}

TEST(Csg, IntersectionBoundsAreTight) {
  Scene scene;
  place_shape(scene, ball(1), moved({-0.9, 0, 0}));
  place_shape(scene, ball(1), moved({0.9, 0, 0}));
  combine(scene, CsgOperation::intersect);
  const Box3f& bounds = scene.meshes[0].shape->bounds;
  const InstanceBoxes boxes = bound_instances(scene, std::vector<Box3f>{bounds, bounds});
  ASSERT_EQ(boxes.boxes.size(), 1u);
  EXPECT_NEAR(boxes.boxes[0].lo.x, -0.1, 1e-4);
  EXPECT_NEAR(boxes.boxes[0].hi.x, 0.1, 1e-4);
}

/// Volume and centroid measured by the lengths of parallel rays inside.
struct Mass {
  double volume = 0;
  Vec3d centroid;
};

Mass mass_of(const Scene& scene, int axis, int n) {
  const SceneAccel accel(scene, in_order());
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  Mass mass;
  const double cell = 4.0 / n;  // over [-2, 2]^2
  for (int i = 0; i < n * n; ++i) {
    Ray ray;
    const int column = i % n, row = i / n;
    ray.origin[u] = static_cast<float>(-2 + (column + 0.5) * cell);
    ray.origin[v] = static_cast<float>(-2 + (row + 0.5) * cell);
    ray.origin[axis] = -4;
    ray.direction[axis] = 1;
    std::vector<double> ts;
    accel.any_hit(ray, [&](const Hit& hit) {
      ts.push_back(static_cast<double>(hit.t) - 4);
      return false;
    });
    std::sort(ts.begin(), ts.end());
    EXPECT_EQ(ts.size() % 2, 0u);
    for (std::size_t k = 0; k + 1 < ts.size(); k += 2) {
      const double volume = (ts[k + 1] - ts[k]) * cell * cell;
      Vec3d at(ray.origin);
      at[axis] = (ts[k] + ts[k + 1]) / 2;
      mass.volume += volume;
      mass.centroid += at * volume;
    }
  }
  mass.centroid = mass.centroid / mass.volume;
  return mass;
}

void expect_mass(const Scene& scene, double volume, const Vec3d& centroid, double tolerance) {
  for (int axis = 0; axis < 3; ++axis) {
    const Mass mass = mass_of(scene, axis, 256);
    EXPECT_NEAR(mass.volume / volume, 1, tolerance) << axis;
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(mass.centroid[k], centroid[k], tolerance) << axis;
  }
}

TEST(CsgVolume, LensMatchesFormula) {
  // Two unit balls whose centres are 1 apart: two caps of height 1/2.
  Scene scene;
  place_shape(scene, ball(1), moved({0.25, -0.5, 0}));
  place_shape(scene, ball(1), moved({0.25, 0.5, 0}));
  combine(scene, CsgOperation::intersect);
  expect_mass(scene, 2 * std::numbers::pi * 0.25 * (1 - 0.5 / 3), {0.25, 0, 0}, 2e-3);
}

TEST(CsgVolume, BoxWithoutCornerMatchesFormula) {
  // 2 x 2 x 2 without the octant above 0: 7, its centre of mass at -1/14 in each axis.
  Scene scene;
  place_shape(scene, make_box({2, 2, 2}));
  place_shape(scene, make_box({1.5, 1.5, 1.5}), moved({0.75, 0.75, 0.75}));
  combine(scene, CsgOperation::subtract);
  const double c = -0.5 / 7;
  expect_mass(scene, 7, {c, c, c}, 1e-6);
}

TEST(CsgVolume, OverlappingBoxesMatchFormula) {
  // The union is 3 x 2 x 2; without the intersection two blocks of 1 x 2 x 2 remain, 2 apart.
  for (const CsgOperation operation : {CsgOperation::unite, CsgOperation::exclude}) {
    Scene scene;
    place_shape(scene, make_box({2, 2, 2}), moved({-0.25, 0.125, 0}));
    place_shape(scene, make_box({2, 2, 2}), moved({0.75, 0.125, 0}));
    combine(scene, operation);
    expect_mass(scene, operation == CsgOperation::unite ? 12 : 8, {0.25, 0.125, 0}, 1e-6);
  }
}

TEST(CsgVolume, DrilledMeshMatchesFormula) {
  Scene scene;
  scene.meshes.push_back(mesh_of({cube(1)}));
  place(scene, 0);
  place_shape(scene, make_cylinder(0.5, 4, true), moved({0.25, 0, 0}));
  combine(scene, CsgOperation::subtract);
  const double hole = std::numbers::pi * 0.25 * 2, volume = 8 - hole;
  expect_mass(scene, volume, {-0.25 * hole / volume, 0, 0}, 2e-3);
}

TEST(Csg, EdgeRaysCrossMeshEvenly) {
  const Primitive sphere = uv_sphere(8, 12, 1);
  Scene scene;
  scene.meshes.push_back(mesh_of({sphere}));
  Dice dice(4);
  place(scene, 0, random_placement(dice, 1.5, {0.25, 0.5, 0}, false));
  place_shape(scene, ball(0.25), moved({9, 9, 9}));  // outside all rays
  combine(scene, CsgOperation::unite);
  const SceneAccel accel(scene, in_order());
  int odd = 0, even = 0;
  for (int i = 0; i < 40'000; ++i) {
    const Vec3d target = transform_point(scene.instances[0].object_to_world,
                                         Vec3d(edge_or_vertex(sphere, i % 2 == 0, dice)));
    Ray ray;
    ray.origin = dice.direction() * 5.0f;
    ray.direction = Vec3f(target - Vec3d(ray.origin));
    int count = 0;
    accel.any_hit(ray, [&](const Hit&) {
      ++count;
      return false;
    });
    odd += count % 2;
    even += count > 0 && count % 2 == 0 ? 1 : 0;
  }
  EXPECT_EQ(odd, 0);
  EXPECT_GT(even, 30'000);
}

}  // namespace
}  // namespace tessera::render::testing
