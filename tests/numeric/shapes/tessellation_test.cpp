// Every shape against its tessellation, whose error falls with the square of the cell size.

#include "tests/support/scene/tessellation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/numeric/shapes/solid_scenes.h"

namespace tessera::render::testing {
namespace {

struct Difference {
  double depth = 0;  // mean difference of t of first hits, in diameters
  double holes = 0;  // fraction of rays that hit only one of the two
};

/// Compares views from all directions at a distance of three diameters.
Difference difference(const Shape& shape, std::uint32_t n) {
  const SceneAccel exact(shape_scene(shape), in_order());
  const SceneAccel mesh(scene_of({tessera::testing::tessellated(shape, n)}), in_order());
  const Vec3d lo(shape.bounds.lo), hi(shape.bounds.hi);
  const double radius = 0.5 * length(hi - lo);
  Dice dice(31);
  Difference out;
  int both = 0, one = 0;
  for (int i = 0; i < 6'000; ++i) {
    const Vec3d from = Vec3d(dice.direction()) * (3 * radius);
    const Vec3d target = Vec3d(dice.vector()) * 0.5 * (hi - lo);
    Ray ray;
    ray.origin = Vec3f((lo + hi) * 0.5 + from);
    ray.direction = Vec3f(normalize(target - from));
    Hit a, b;
    const bool first = exact.closest_hit(ray, a), second = mesh.closest_hit(ray, b);
    one += first != second ? 1 : 0;
    if (!first || !second) continue;
    ++both;
    // Beyond the edge of one, a ray may hit another part of the other: no difference of depth.
    const double apart = std::fabs(static_cast<double>(a.t) - static_cast<double>(b.t)) / radius;
    if (apart > 0.1) {
      ++one;
    } else {
      out.depth += apart;
    }
  }
  EXPECT_GT(both, 2'000);
  out.depth /= both;
  out.holes = one / 6'000.0;
  return out;
}

TerrainForm dunes(TerrainForm::Pattern pattern) {
  TerrainForm form;
  form.pattern = pattern;
  form.size = {2, 2};
  form.height = 0.35;
  form.octaves = 2;
  form.seed = 3;
  return form;
}

/// An ellipsoid not aligned with the axes; with caps if `cut`: a box cuts it on five sides.
Shape tilted_bowl(bool cut) {
  const Quadric quadric = {{1, 2, 1.5}, {0.3, -0.2, 0.25}, {0.1, -0.05, 0.1}, -0.5};
  const double far = cut ? 0.5 : 0.95;
  return make_quadric(quadric, {{-far, -far, -far}, {far, far, 0.95}}, cut);
}

struct Named {
  std::string name;
  Shape shape;
};

TEST(Tessellation, ConvergesToEveryShape) {
  const std::vector<Named> shapes = {
      {"sphere", make_ellipsoid({1, 1, 1})},
      {"ellipsoid", make_ellipsoid({1, 0.5, 0.75})},
      {"cylinder", make_cylinder(0.75, 1, true)},
      {"open cylinder", make_cylinder(0.75, 1, false)},
      {"disc", make_disc(1)},
      {"cone", make_cone(0.75, 2, true)},
      {"paraboloid", make_paraboloid(1, 1.5, true)},
      {"hyperboloid", make_one_sheet_hyperboloid(0.25, 1, 2, true)},
      {"two-sheet-hyperboloid", make_two_sheet_hyperboloid(0.5, 1, 2, true)},
      {"torus", make_torus(0.75, 0.25)},
      {"blobs",
       make_blobs({{{0.3, 0, 0}, {0.8, 0.6, 0.8}, 1}, {{-0.3, 0.1, 0}, {1, 1, 1}, 1.5}}, 0.25)},
      {"waves", make_terrain(dunes(TerrainForm::Pattern::waves), 0)},
      {"fbm", make_terrain(dunes(TerrainForm::Pattern::fbm), 0)},
      {"ridged", make_terrain(dunes(TerrainForm::Pattern::ridged), 0)},
      {"quadric", tilted_bowl(false)},
      {"capped quadric", tilted_bowl(true)},
  };
  for (const auto& [name, shape] : shapes) {
    const Difference coarse = difference(shape, 24), fine = difference(shape, 96);
    if (name != "disc") {  // flat: only its rim differs
      const double order = std::log2(coarse.depth / fine.depth) / 2;
      EXPECT_GT(order, 1.7) << name;
      EXPECT_LT(order, 2.4) << name;
    }
    EXPECT_LT(fine.depth, 1e-3) << name;
    EXPECT_LE(fine.holes, 0.5 * coarse.holes + 1e-3) << name;
    // Crests are cut off by up to the width of a cell, not by its square.
    EXPECT_LT(fine.holes, name == "ridged" ? 8e-3 : 4e-3) << name;
  }
}

TEST(Tessellation, FlatShapesAreExact) {
  for (const Shape& shape : {make_box({1, 2, 1.5}), make_rectangle(1, 2)}) {
    const Difference found = difference(shape, 4);
    EXPECT_LT(found.depth, 1e-6);
    EXPECT_LT(found.holes, 1e-3);
  }
}

}  // namespace
}  // namespace tessera::render::testing
