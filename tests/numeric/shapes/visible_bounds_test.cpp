/// Boxes around turned objects: of the transformed points, not of transformed boxes.

#include "worker/scene/visible_bounds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/numeric/shapes/solid_scenes.h"
#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/shape_support.h"

namespace tessera::render::testing {
namespace {

Affine3d turned_about_y(double degrees, const Vec3d& place) {
  const double s = std::sin(degrees * std::numbers::pi / 180),
               c = std::cos(degrees * std::numbers::pi / 180);
  return {{Vec3d{c, 0, s}, Vec3d{0, 1, 0}, Vec3d{-s, 0, c}}, place};
}

void expect_box(const Box3d& box, const Vec3d& low, const Vec3d& high, double tolerance) {
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(box.lo[k], low[k], tolerance) << k;
    EXPECT_NEAR(box.hi[k], high[k], tolerance) << k;
  }
}

TEST(VisibleBounds, TurnedMeshSphereKeepsItsSize) {
  Scene scene;
  scene.meshes = {mesh_of({uv_sphere(16, 32, 1)})};
  place(scene, 0, turned_about_y(45, {3, 4, 5}));
  expect_box(visible_bounds(scene), {2, 3, 4}, {4, 5, 6}, 1e-6);
}

TEST(VisibleBounds, RodTurnedOnToItsAxisIsThin) {
  Scene scene;
  Primitive rod = uv_sphere(16, 32, 1);
  for (Vec3f& p : rod.positions) p *= Vec3f{10, 0.1f, 0.1f};
  scene.meshes = {mesh_of({rod})};
  place(scene, 0, {{Vec3d{0, -1, 0}, Vec3d{1, 0, 0}, Vec3d{0, 0, 1}}, {}});
  place(scene, 0, turned_about_y(30, {}));  // lies within the first but for its ends
  const double x = 10 * std::cos(std::numbers::pi / 6), z = 5;
  expect_box(visible_bounds(scene), {-x, -10, -z}, {x, 10, z}, 0.06);
}

TEST(VisibleBounds, TurnedShapesKeepTheirSize) {
  Scene ball;
  place_shape(ball, make_ellipsoid({1, 1, 1}), turned_about_y(45, {}));
  expect_box(visible_bounds(ball), {-1, -1, -1}, {1, 1, 1}, 1e-12);
  Scene flat;
  place_shape(flat, make_ellipsoid({1, 1, 1}), turned_about_y(45, {}));
  flat.instances[0].flat = true;
  EXPECT_TRUE(visible_bounds(flat).empty());
  EXPECT_TRUE(visible_bounds(Scene()).empty());
}

/// An ellipsoid with radii 0.5, 1, 2 around (0.1, 0.2, 0.3), turned about y, in a larger box.
Shape turned_ellipsoid() {
  const Affine3d turn = turned_about_y(30, {});
  const Vec3d weight = {4, 1, 0.25}, centre = {0.1, 0.2, 0.3};
  Quadric q;
  const auto entry = [&](std::size_t i, std::size_t j) {
    return dot(turn.rows[i] * weight, turn.rows[j]);
  };
  q.squares = {entry(0, 0), entry(1, 1), entry(2, 2)};
  q.products = {entry(1, 2), entry(2, 0), entry(0, 1)};
  q.linear = -q.times(centre);
  q.constant = dot(centre, q.times(centre)) - 1;
  return make_quadric(q, {{-3, -3, -3}, {3, 3, 3}}, true);
}

struct Bounded {
  Shape shape;
  double slack;  // of the bound, relative to the shape's size; includes the sampling of its points
};

/// Points are found by lines through the shape's box.
TEST(ShapeSupport, BoundsAllPointsTightly) {
  const Bounded shapes[] = {{make_ellipsoid({1, 2, 0.5}), 0.02}, {make_box({1, 2, 3}), 0.06},
                            {make_cylinder(0.7, 2, true), 0.05}, {make_disc(1), 0.03},
                            {make_torus(1, 0.3), 0.02},          {turned_ellipsoid(), 0.02},
                            {make_cone(1, 2, true), 0.6}};
  Dice dice(71);
  for (const auto& [shape, slack] : shapes) {
    const Vec3d lo(shape.bounds.lo), hi(shape.bounds.hi);
    const double size = length(hi - lo);
    std::vector<Vec3d> points;
    for (int i = 0; i < 40'000; ++i) {
      const Vec3d through = lo + (hi - lo) * (Vec3d(dice.vector()) * 0.5 + Vec3d{0.5, 0.5, 0.5});
      std::vector<ShapeHit> hits;
      intersect_shape(shape, through, Vec3d(dice.direction()), hits);
      for (const ShapeHit& hit : hits) points.push_back(hit.point);
    }
    ASSERT_GT(points.size(), 1'000u);
    for (int i = 0; i < 50; ++i) {
      const Vec3d direction(dice.direction());
      double reach = -HUGE_VAL;
      for (const Vec3d& p : points) reach = std::max(reach, dot(direction, p));
      const double bound = support(shape, direction);
      EXPECT_LE(reach, bound + 1e-6 * size);
      EXPECT_GE(reach, bound - slack * size);
    }
  }
}

}  // namespace
}  // namespace tessera::render::testing
