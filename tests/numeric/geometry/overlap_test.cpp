// Hard case 36: overlapping triangles and closed surfaces are detected exactly.

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "worker/accel/overlap/mesh_overlap.h"
#include "worker/geometry/exact_sign.h"
#include "worker/geometry/triangle.h"
#include "worker/math/float_bits.h"

namespace tessera::render::testing {
namespace {

/// Returns a tetrahedron, wound outwards if d is behind a, b, c. Triangle 0 is a b c; triangles 1,
/// 2 and 3 contain d and an edge of triangle 0.
Primitive tetrahedron(const Vec3f& a, const Vec3f& b, const Vec3f& c, const Vec3f& d) {
  Primitive p;
  p.positions = {a, b, c, d};
  p.triangles = {{0, 1, 2}, {1, 0, 3}, {2, 1, 3}, {0, 2, 3}};
  return p;
}

using Pairs = std::vector<OverlapPair>;

Pairs pairs_of(const Primitive& first, const Primitive& second) {
  return self_intersections(mesh_of({first, second}));
}

OverlapPair pair(std::uint32_t first, std::uint32_t second) {
  return {{0, first}, {1, second}};
}

const Primitive one_tetrahedron = tetrahedron({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, -1});

TEST(MeshOverlap, SharedFaceIsOnlyOverlap) {
  EXPECT_EQ(pairs_of(one_tetrahedron, tetrahedron({0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1})),
            (Pairs{pair(0, 0)}));
}

TEST(MeshOverlap, SharedEdgeOrVertexIsNoOverlap) {
  EXPECT_EQ(pairs_of(one_tetrahedron, tetrahedron({0, 0, 0}, {1, 0, 0}, {0, -1, 0.5f}, {0, -1, 1})),
            Pairs{});
  EXPECT_EQ(pairs_of(one_tetrahedron, tetrahedron({0, 0, 0}, {-1, 0, 0}, {0, -1, 1}, {0, 0, 1})),
            Pairs{});
}

TEST(MeshOverlap, OneUlpGapSeparates) {
  // A tetrahedron whose tip is at (0.25, 0.25, z), over the inside of triangle 0.
  const auto over = [](float z) {
    return tetrahedron({0, 0, 1}, {0, 1, 1}, {1, 0, 1}, {0.25f, 0.25f, z});
  };
  EXPECT_EQ(pairs_of(one_tetrahedron, over(0x1p-149f)), Pairs{});
  EXPECT_EQ(pairs_of(one_tetrahedron, over(0)), (Pairs{pair(0, 1), pair(0, 2), pair(0, 3)}));
  // The same far from the origin, where an ulp is 2^-3.
  const auto moved = [](Primitive p) {
    for (Vec3f& v : p.positions) v = v * 16.0f + Vec3f{1 << 20, 1 << 20, 1 << 20};
    return p;
  };
  Primitive near = moved(over(0));
  EXPECT_EQ(pairs_of(moved(one_tetrahedron), near).size(), 3u);
  near.positions[3].z = next_up(near.positions[3].z);
  EXPECT_EQ(pairs_of(moved(one_tetrahedron), near), Pairs{});
}

TEST(MeshOverlap, CrossingPairsAreListed) {
  // The other tetrahedron's tip enters through triangle 0 and ends inside.
  const Primitive other =
      tetrahedron({0.1f, 0.1f, 1}, {0.1f, 0.3f, 1}, {0.3f, 0.1f, 1}, {0.2f, 0.2f, -0.1f});
  EXPECT_EQ(pairs_of(one_tetrahedron, other), (Pairs{pair(0, 1), pair(0, 2), pair(0, 3)}));
}

TEST(MeshOverlap, ConvexMeshIsClosedWithoutOverlap) {
  const Mesh sphere = mesh_of({uv_sphere(12, 16, 1)});
  EXPECT_EQ(self_intersections(sphere), Pairs{});
  EXPECT_EQ(boundary_edges(sphere, {true}), 0);
  Primitive punctured = uv_sphere(12, 16, 1);
  punctured.triangles.erase(punctured.triangles.begin() + 40);
  EXPECT_EQ(boundary_edges(mesh_of({punctured}), {true}), 3);
  Primitive flipped = uv_sphere(12, 16, 1);
  std::swap(flipped.triangles[40][0], flipped.triangles[40][1]);
  EXPECT_EQ(boundary_edges(mesh_of({flipped}), {true}), 3);
  // A seam whose sides differ by rounding is open unless the tolerance covers it.
  Primitive cracked = sphere.primitives[0];
  const std::uint32_t moved = cracked.triangles[0][0];
  cracked.positions.push_back(cracked.positions[moved] + render::Vec3f{2e-7f, -2e-7f, 0});
  cracked.triangles[0][0] = static_cast<std::uint32_t>(cracked.positions.size() - 1);
  EXPECT_GT(boundary_edges(mesh_of({cracked}), {true}), 0);
  EXPECT_GT(boundary_edges(mesh_of({cracked}), {true}, 1e-8), 0);
  EXPECT_EQ(boundary_edges(mesh_of({cracked}), {true}, 1e-6), 0);
}

TEST(MeshOverlap, NeighboursOverlapOnlyIfFolded) {
  const Vec3f a = {0, 0, 0}, b = {1, 0, 0}, up = {0, 1, 0}, down = {0, -1, 0};
  const Vec3f tilted = {0, 1, 0x1p-140f};
  EXPECT_FALSE(triangles_overlap({a, b, up}, {b, a, down}));      // flat
  EXPECT_TRUE(triangles_overlap({a, b, up}, {b, a, {1, 1, 0}}));  // folded back
  EXPECT_FALSE(triangles_overlap({a, b, up}, {b, a, tilted}));    // almost folded back
  EXPECT_FALSE(triangles_overlap({a, b, up}, {a, {-1, 0, 0}, down}));
  EXPECT_TRUE(triangles_overlap({a, b, up}, {a, {1, 1, 1}, {1, 1, -1}}));  // through the corner
  EXPECT_TRUE(triangles_overlap({a, b, up}, {a, {2, 1, 0}, {1, 2, 0}}));   // in its plane
  EXPECT_FALSE(triangles_overlap({a, b, up}, {a, {2, -1, 0}, {-1, -2, 0}}));
}

TEST(MeshOverlap, TreeMatchesExhaustiveSearch) {
  Dice dice(9);
  for (const Primitive& p : {soup(150, dice), terrain(8, dice), needles(60, dice)}) {
    Pairs expected;
    const auto corners = [&](std::uint32_t t) {
      const auto& [i, j, k] = p.triangles[t];
      return TriangleCorners{p.positions[i], p.positions[j], p.positions[k]};
    };
    const auto count = static_cast<std::uint32_t>(p.triangles.size());
    for (std::uint32_t i = 0; i < count; ++i) {
      for (std::uint32_t j = i + 1; j < count; ++j) {
        const auto hittable = [&](std::uint32_t t) {
          const TriangleCorners c = corners(t);
          return is_hittable(c[0], c[1], c[2]);
        };
        if (hittable(i) && hittable(j) && triangles_overlap(corners(i), corners(j))) {
          expected.push_back({{0, i}, {0, j}});
        }
      }
    }
    EXPECT_EQ(self_intersections(mesh_of({p})), expected);
  }
}

TEST(MeshOverlap, InstanceTransformsAreApplied) {
  Scene scene;
  scene.meshes = {mesh_of({uv_sphere(6, 8, 1)})};
  for (const double x : {0.0, 1.5, 3.6}) {
    Affine3d m;
    m.translation = {x, 0, 0};
    place(scene, 0, m);
  }
  const std::vector<InstanceOverlap> overlaps = instance_overlaps(scene);
  ASSERT_EQ(overlaps.size(), 1u);
  EXPECT_EQ(overlaps[0].a, 0u);
  EXPECT_EQ(overlaps[0].b, 1u);
  EXPECT_GT(overlaps[0].pairs.size(), 8u);
}

TEST(MeshOverlap, InstancesMatchExhaustiveSearch) {
  Dice dice(10);
  Scene scene;
  scene.meshes = {mesh_of({uv_sphere(4, 6, 1)}), mesh_of({soup(12, dice)}), mesh_of({})};
  for (int i = 0; i < 90; ++i) {
    place(scene, i % 3, random_placement(dice, 0.4, Vec3d(dice.vector()), i % 2 == 0));
  }
  std::vector<std::pair<std::uint32_t, std::uint32_t>> expected, found;
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    for (std::uint32_t j = i + 1; j < scene.instances.size(); ++j) {
      Scene pair = scene;
      pair.instances = {scene.instances[i], scene.instances[j]};
      if (!instance_overlaps(pair).empty()) expected.emplace_back(i, j);
    }
  }
  for (const InstanceOverlap& overlap : instance_overlaps(scene)) {
    found.emplace_back(overlap.a, overlap.b);
  }
  EXPECT_GT(expected.size(), 20u);
  EXPECT_EQ(found, expected);
}

TEST(MeshOverlap, CrossingAmongManyInstancesIsFound) {
  Scene scene;
  scene.meshes = {mesh_of({uv_sphere(3, 4, 0.4f)})};
  constexpr int kSide = 450;
  for (int i = 0; i < kSide * kSide; ++i) {
    Affine3d m;
    m.translation = {static_cast<double>(i % kSide), static_cast<double>(i / kSide), 0};
    place(scene, 0, m);
  }
  EXPECT_EQ(instance_overlaps(scene).size(), 0u);
  Affine3d crossing;
  crossing.translation = {10.5, 20, 0};
  place(scene, 0, crossing);
  EXPECT_EQ(instance_overlaps(scene).size(), 2u);
}

TEST(ExactSign, OneUlpOffPlaneIsDetected) {
  // d is an ulp off the plane x + y + z = 3 * 2^20 through a, b, c.
  const float big = 1 << 20;
  const Vec3f a = {big, big, big}, b = {big + 1, big - 1, big}, c = {big - 1, big, big + 1};
  const Vec3f on = {0.1f, 3 * big, -0.1f};
  EXPECT_EQ(side_of_plane(a, b, c, on), 0);
  const int up = side_of_plane(a, b, c, {on.x, on.y, next_up(on.z)});
  EXPECT_EQ(std::abs(up), 1);
  EXPECT_EQ(side_of_plane(a, b, c, {on.x, on.y, next_down(on.z)}), -up);
  EXPECT_EQ(side_of_plane(b, a, c, {on.x, on.y, next_up(on.z)}), -up);
}

}  // namespace
}  // namespace tessera::render::testing
