// Hard cases 13 to 16, 32 and 35 for the structures of worker/accelerators: their hits equal those
// of brute force bit for bit.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "worker/accel/reference/brute_force.h"
#include "worker/accelerators/grids/grid.h"
#include "worker/accelerators/structure_accelerator.h"

namespace tessera::render::accelerators {

// NOLINTNEXTLINE(readability-identifier-naming): name required by GoogleTest
void PrintTo(const Structure& structure, std::ostream* out) {
  *out << structure.name;
}

}  // namespace tessera::render::accelerators

namespace tessera::render::testing {
namespace {

using accelerators::Structure;
using accelerators::StructureAccelerator;
using accelerators::structures;

/// A scene, rays in it, and their hits by brute force.
struct Trial {
  Scene scene;
  std::vector<Ray> rays;
  std::vector<bool> found;
  std::vector<Hit> hits;
  std::size_t hit_count = 0;

  void add(const Ray& ray) {
    Hit hit;
    rays.push_back(ray);
    found.push_back(brute_force_closest(scene, ray, hit));
    hits.push_back(hit);
    hit_count += found.back() ? 1 : 0;
  }
  void add_adversarial(int count, Dice& dice) {
    for (int i = 0; i < count; ++i) add(adversarial_ray(scene, dice));
  }
};

/// Counts rays whose closest or any hit differs from brute force in any bit.
int mismatches(const Trial& trial, const Structure& structure) {
  const StructureAccelerator accel(trial.scene, structure, trial.rays);
  int wrong = 0;
  for (std::size_t i = 0; i < trial.rays.size(); ++i) {
    Hit hit;
    accelerators::TraversalStats stats;
    const bool found = accel.closest_hit(trial.rays[i], hit, stats);
    if (found != trial.found[i] || (found && !same_bits(hit, trial.hits[i]))) ++wrong;
    if (accel.any_hit(trial.rays[i], stats) != trial.found[i]) ++wrong;
  }
  return wrong;
}

class AllStructures : public ::testing::TestWithParam<Structure> {};

INSTANTIATE_TEST_SUITE_P(, AllStructures,
                         ::testing::ValuesIn(structures().begin(), structures().end()),
                         [](const auto& of) {
                           std::string name(of.param.name);
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST_P(AllStructures, SoupsAgree) {
  Dice dice(1);
  Trial trial;
  trial.scene = scene_of({soup(150, dice), soup(60, dice)});
  trial.add_adversarial(30'000, dice);
  EXPECT_GT(trial.hit_count, 10'000u);
  EXPECT_EQ(mismatches(trial, GetParam()), 0);
}

TEST_P(AllStructures, TerrainAgrees) {
  Dice dice(2);
  Trial trial;
  trial.scene = scene_of({terrain(10, dice)});
  trial.add_adversarial(30'000, dice);
  EXPECT_GT(trial.hit_count, 10'000u);
  EXPECT_EQ(mismatches(trial, GetParam()), 0);
}

TEST_P(AllStructures, SlantedNeedlesAgree) {
  Dice dice(3);
  Trial trial;
  trial.scene = scene_of({needles(250, dice)});
  trial.add_adversarial(20'000, dice);
  EXPECT_GT(trial.hit_count, 7'000u);
  EXPECT_EQ(mismatches(trial, GetParam()), 0);
}

TEST_P(AllStructures, InstancesAgree) {
  Dice dice(4);
  Trial trial;
  trial.scene.meshes = {mesh_of({soup(20, dice), soup(10, dice)}), mesh_of({uv_sphere(4, 6, 1)}),
                        mesh_of({})};
  for (int i = 0; i < 12; ++i) {
    const double scale = std::exp2(-6 * dice.unit());
    place(trial.scene, i % 3, random_placement(dice, scale, Vec3d(dice.vector()), i % 2 == 0));
  }
  place(trial.scene, 0);
  place(trial.scene, 1);
  place(trial.scene, 1);  // an exact duplicate
  Affine3d squashed = random_placement(dice, 1, {0, 0, 0}, false);
  squashed.rows[1] *= 1e-4;
  place(trial.scene, 1, squashed);
  trial.add_adversarial(20'000, dice);
  EXPECT_GT(trial.hit_count, 7'000u);
  EXPECT_EQ(mismatches(trial, GetParam()), 0);
}

TEST_P(AllStructures, AnyOriginAgrees) {
  Dice dice(5);
  Trial trial;
  trial.scene = scene_of({uv_sphere(8, 12, 1), quad({-1, 0, -1}, {2, 0, 0}, {0, 0, 2})});
  const Primitive& sphere = trial.scene.meshes[0].primitives[0];
  for (int i = 0; i < 20'000; ++i) {
    Ray ray;
    if (i % 2 == 0) {
      ray.origin = dice.direction() * std::exp2(24 * dice.unit());
      ray.direction = dice.vector() - ray.origin;
    } else {
      ray.origin = edge_or_vertex(sphere, i % 4 == 1, dice);
      ray.direction = edge_or_vertex(sphere, true, dice) - ray.origin;
    }
    trial.add(ray);
  }
  EXPECT_GT(trial.hit_count, 5'000u);
  EXPECT_EQ(mismatches(trial, GetParam()), 0);
}

/// Covers hard case 32 and meshes of one triangle or of coplanar triangles.
TEST_P(AllStructures, DegenerateMeshAgrees) {
  Dice dice(6);
  Primitive nested, coplanar;
  for (int i = 0; i < 60; ++i) {
    const auto first = static_cast<std::uint32_t>(3 * i);
    const float size = std::exp2(-static_cast<float>(i % 20));
    for (Primitive* p : {&nested, &coplanar}) p->triangles.push_back({first, first + 1, first + 2});
    nested.positions.insert(nested.positions.end(),
                            {{-size, 0, -size}, {size, 0, -size}, {0, 0, 2 * size}});
    for (int k = 0; k < 3; ++k) coplanar.positions.push_back({dice.both(), 0.25f, dice.both()});
  }
  Primitive one;
  one.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  one.triangles = {{0, 1, 2}};
  for (const Primitive& each : {nested, coplanar, one}) {
    Trial trial;
    trial.scene = scene_of({each});
    trial.add_adversarial(4'000, dice);
    EXPECT_GT(trial.hit_count, 200u);
    EXPECT_EQ(mismatches(trial, GetParam()), 0);
  }
}

/// Hard case 33: rays with NaN, infinite or zero components miss, as do all rays in an empty scene.
TEST_P(AllStructures, InvalidRaysMiss) {
  const float infinity = std::numeric_limits<float>::infinity();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const StructureAccelerator full(scene_of({uv_sphere(4, 6, 1)}), GetParam());
  const StructureAccelerator empty(Scene{}, GetParam());
  const StructureAccelerator hollow(scene_of({}), GetParam());
  Hit hit;
  for (const Vec3f& bad :
       {Vec3f{}, Vec3f{nan, 1, 0}, Vec3f{0, infinity, 0}, Vec3f{-0.0f, 0, 1e-40f}}) {
    EXPECT_FALSE(full.closest_hit({{0, 0, 0}, bad}, nullptr, hit));
  }
  EXPECT_FALSE(full.closest_hit({{nan, 0, 0}, {1, 0, 0}}, nullptr, hit));
  EXPECT_TRUE(full.closest_hit({{0, 0, 0}, {1, 0, 0}}, nullptr, hit));
  EXPECT_FALSE(empty.closest_hit({{0, 0, 0}, {1, 0, 0}}, nullptr, hit));
  EXPECT_FALSE(hollow.any_hit({{0, 0, 0}, {1, 0, 0}}, nullptr));
}

TEST_P(AllStructures, AllHitsAreOrdered) {
  Dice dice(7);
  const Scene scene = scene_of({soup(60, dice), needles(60, dice)});
  const StructureAccelerator accel(scene, GetParam());
  std::size_t count = 0;
  for (int i = 0; i < 2'000; ++i) {
    const Ray ray = adversarial_ray(scene, dice);
    std::vector<Hit> expected;
    brute_force_hits(scene, ray, [&](const Hit& hit) { expected.push_back(hit); });
    std::sort(expected.begin(), expected.end(), precedes);
    const std::vector<Hit> hits = accel.all_hits(ray);
    ASSERT_EQ(hits.size(), expected.size());
    for (std::size_t k = 0; k < hits.size(); ++k) ASSERT_TRUE(same_bits(hits[k], expected[k]));
    std::size_t shown = 0;
    const auto count_shown = [&](const Hit&) { return ++shown == 0; };
    ASSERT_EQ(accel.any_hit(ray, nullptr), !expected.empty());
    const HitFilter filter(count_shown);
    ASSERT_FALSE(accel.any_hit(ray, &filter));
    ASSERT_EQ(shown, expected.size());
    count += hits.size();
  }
  EXPECT_GT(count, 1'000u);
}

TEST(UniformGrid, DiagonalRaysVisitDiagonalCells) {
  // 256 shapes at 2 cells per shape give 512 cells, 8 per side without the pad. Any number works.
  const accelerators::Grid grid({{0, 0, 0}, {8, 8, 8}}, 256);
  for (const float sign : {1.0f, -1.0f}) {
    accelerators::ShapeRay ray;
    const Vec3f origin = sign > 0 ? Vec3f{-1, -1, -1} : Vec3f{9, 9, 9};
    ASSERT_TRUE(
        accelerators::make_shape_ray(origin, Vec3f{1, 1, 1} * sign, {{0, 0, 0}, {8, 8, 8}}, ray));
    std::set<std::array<int, 3>> visited;
    accelerators::GridTraversal traversal(grid, ray, grid.inside(ray, 1e6f).first);
    do visited.insert(traversal.cell());
    while (traversal.next());
    ASSERT_GE(grid.count(0), 6);
    for (int i = 0; i < grid.count(0); ++i) EXPECT_TRUE(visited.count({i, i, i})) << i;
  }
}

TEST(UniformGrid, RaysInCellPlanesHitQuadsOnThem) {
  // Quads on every plane between grid cells, and rays in those planes through the quads' edges.
  Trial trial;
  std::vector<Primitive> quads;
  for (int i = 0; i <= 8; ++i) {
    const auto x = static_cast<float>(i);
    quads.push_back(quad({x, 0, 0}, {0, 8, 0}, {0, 0, 8}));
    quads.push_back(quad({0, x, 0}, {8, 0, 0}, {0, 0, 8}));
  }
  trial.scene = scene_of(std::move(quads));
  for (int i = 0; i <= 8; ++i) {
    for (int j = 0; j <= 8; ++j) {
      const Vec3f at = {static_cast<float>(i), static_cast<float>(j), 4};
      for (const Vec3f& d : {Vec3f{1, 0, 0}, Vec3f{0, -1, 0}, Vec3f{0, 0, 1}, Vec3f{1, 1, 0}}) {
        Ray ray;
        ray.origin = at - d * 20.0f;
        ray.direction = d;
        trial.add(ray);
      }
    }
  }
  EXPECT_GT(trial.hit_count, 150u);
  for (const Structure& structure : structures()) {
    EXPECT_EQ(mismatches(trial, structure), 0) << structure.name;
  }
}

/// A uniform grid over the whole scene puts a small dense mesh into one cell, so that a ray tests
/// thousands of its triangles. Hierarchies adapt to the density and test a few.
TEST(TeapotInAStadium, SlowsGridsNotHierarchies) {
  const Scene scene = scene_of(
      {uv_sphere(40, 60, 0.5f, {0, 0.5f, 0}), quad({-200, 0, 200}, {400, 0, 0}, {0, 0, -400})});
  Dice dice(8);
  std::vector<Ray> rays;
  for (int i = 0; i < 2'000; ++i) {
    rays.push_back({{0, 1.5f, 3}, dice.vector() * 0.6f + Vec3f{0, -1, -3}});
  }
  const auto triangles_per_ray = [&](std::string_view name) {
    const StructureAccelerator accel(scene, *accelerators::find_structure(name));
    accelerators::TraversalStats stats;
    Hit hit;
    for (const Ray& ray : rays) accel.closest_hit(ray, hit, stats);
    return static_cast<double>(stats.shapes) / static_cast<double>(rays.size());
  };
  for (const char* grid : {"grid", "grid-mailboxes", "proximity-grid"})
    EXPECT_GT(triangles_per_ray(grid), 1000) << grid;
  for (const char* adaptive :
       {"bvh2", "rdh-bvh", "bvh2-skip", "bvh2-parents", "spheres", "oriented-boxes", "axis-bsp",
        "kd-tree", "octree", "hierarchical-grid"}) {
    EXPECT_LT(triangles_per_ray(adaptive), 50) << adaptive;
  }
  for (const char* slower : {"recursive-grid", "polygon-bsp", "polygon-bsp-split"}) {
    EXPECT_LT(triangles_per_ray(slower), 400) << slower;
  }
  // The ring has more triangles than the small mailbox remembers.
  EXPECT_GT(triangles_per_ray("grid"), triangles_per_ray("grid-mailboxes"));
  EXPECT_LE(triangles_per_ray("grid-mailboxes"), 2 * 60 * 39 + 2);
}

/// Nodes and triangles per ray of a structure in a mesh.
accelerators::TraversalStats cost_in(const Scene& scene, std::string_view name) {
  Dice dice(8);
  const StructureAccelerator accel(scene, *accelerators::find_structure(name));
  accelerators::TraversalStats stats;
  for (int i = 0; i < 2'000; ++i) {
    Hit hit;
    accel.closest_hit(adversarial_ray(scene, dice), hit, stats);
  }
  return stats;
}

TEST(ParentBvh, VisitsFewerNodesThanSkipPointers) {
  Dice dice(9);
  const Scene scene = scene_of({soup(2'000, dice)});
  EXPECT_LT(cost_in(scene, "bvh2-parents").nodes, cost_in(scene, "bvh2-skip").nodes);
}

TEST(SplittingBsp, TestsFewerTrianglesThanUnsplit) {
  Dice dice(10);
  const Scene scene = scene_of({soup(300, dice)});
  EXPECT_LT(cost_in(scene, "polygon-bsp-split").shapes, cost_in(scene, "polygon-bsp").shapes);
}

TEST(KdTree, VisitsOtherNodesThanAxisBsp) {
  Dice dice(11);
  const Scene scene = scene_of({needles(300, dice)});
  EXPECT_NE(cost_in(scene, "kd-tree").nodes, cost_in(scene, "axis-bsp").nodes);
}

/// Spheres behind a wall and one in front of it, and rays that start in front.
struct HiddenSpheres {
  Scene scene;
  std::vector<Ray> rays;

  HiddenSpheres() {
    std::vector<Primitive> parts = {
        quad({-3, 0, 0}, {6, 0, 0}, {0, 2.5f, 0}), quad({-3, 0, 3}, {0, 0, -6}, {0, 2.5f, 0}),
        quad({3, 0, 3}, {0, 0, -6}, {0, 2.5f, 0}), quad({-3, 0, 3}, {6, 0, 0}, {0, 0, -6}),
        uv_sphere(8, 12, 0.4f, {0, 0.5f, 1.5f})};
    for (int i = 0; i < 20; ++i) {
      const Vec3f centre = {static_cast<float>(i % 5) - 2, static_cast<float>(i / 5 % 2) + 0.5f,
                            -0.6f - static_cast<float>(i / 10)};
      parts.push_back(uv_sphere(8, 12, 0.4f, centre));
    }
    scene = scene_of(std::move(parts));
    Dice dice(12);
    for (int i = 0; i < 4'000; ++i) {
      const Vec3f origin = Vec3f{0, 1.25f, 2} + dice.vector();
      rays.push_back({origin, dice.vector()});
    }
  }
  /// The rays, each with t_max at its hit.
  std::vector<Ray> ending_at_hits() const {
    std::vector<Ray> out = rays;
    for (Ray& ray : out) {
      Hit hit;
      if (brute_force_closest(scene, ray, hit)) ray.t_max = hit.t;
    }
    return out;
  }
  std::int64_t triangles_tested(std::string_view name, std::span<const Ray> sample) const {
    const StructureAccelerator accel(scene, *accelerators::find_structure(name), sample);
    accelerators::TraversalStats stats;
    Hit hit;
    for (const Ray& ray : rays) accel.closest_hit(ray, hit, stats);
    return stats.shapes;
  }
};

TEST(RdhBvh, TestsFewerTrianglesWhereMuchIsHidden) {
  const HiddenSpheres room;
  const std::vector<Ray> sample = room.ending_at_hits();
  EXPECT_LT(2 * room.triangles_tested("rdh-bvh", sample), room.triangles_tested("bvh2", {}));
}

TEST(RdhBvh, WithoutRaysSplitsByArea) {
  const HiddenSpheres room;
  EXPECT_EQ(room.triangles_tested("rdh-bvh", {}), room.triangles_tested("bvh2", {}));
}

TEST(RdhBvh, RecordedRayEndsSaveTriangleTests) {
  const HiddenSpheres room;
  EXPECT_LT(room.triangles_tested("rdh-bvh", room.ending_at_hits()),
            room.triangles_tested("rdh-bvh", room.rays));
}

}  // namespace
}  // namespace tessera::render::testing
