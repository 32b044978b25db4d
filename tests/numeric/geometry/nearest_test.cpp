// Nearest-neighbour search: both trees return what brute force returns, bit for bit.

#include "worker/accelerators/points/nearest.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/numeric/geometry/geometry_scenes.h"

namespace tessera::render::testing {
namespace {

using accelerators::build_point_bvh;
using accelerators::build_point_kd_tree;
using accelerators::nearest_by_brute_force;
using accelerators::Neighbour;
using accelerators::PointIndex;
using accelerators::SearchStats;

struct Trees {
  std::unique_ptr<PointIndex> kd_tree, bvh;

  explicit Trees(const std::vector<Vec3f>& points)
      : kd_tree(build_point_kd_tree(points)), bvh(build_point_bvh(points)) {}
};

/// Searches near points and away from them, for few, many and more than all neighbours.
void expect_equal(const std::vector<Vec3f>& points, float reach) {
  const Trees trees(points);
  Dice dice(1);
  for (int i = 0; i < 300; ++i) {
    Vec3f query = dice.vector() * reach;
    if (!points.empty() && i % 3 != 0) {
      query = points[dice.below(static_cast<std::uint32_t>(points.size()))];
      if (i % 3 == 1) query = query + dice.vector() * (reach / 64);
    }
    for (const std::size_t k :
         {std::size_t{0}, std::size_t{1}, std::size_t{7}, points.size() + 3}) {
      const std::vector<Neighbour> expected = nearest_by_brute_force(points, query, k);
      SearchStats stats;
      ASSERT_EQ(trees.kd_tree->nearest(query, k, stats), expected) << "kd-tree, k = " << k;
      ASSERT_EQ(trees.bvh->nearest(query, k, stats), expected) << "BVH, k = " << k;
    }
  }
}

std::vector<Vec3f> random_points(int count) {
  Dice dice(2);
  std::vector<Vec3f> points;
  for (int i = 0; i < count; ++i) points.push_back(dice.vector());
  return points;
}

TEST(NearestPoints, RandomPointsAgree) {
  for (const int count : {1, 2, 5, 600}) expect_equal(random_points(count), 2);
}

TEST(NearestPoints, NoPointsGiveNoNeighbours) {
  expect_equal({}, 1);
}

TEST(NearestPoints, TiesAreOrderedByIndex) {
  std::vector<Vec3f> points;  // a lattice: most distances occur many times
  for (int i = 0; i < 512; ++i) {
    points.push_back(
        {static_cast<float>(i % 8), static_cast<float>(i / 8 % 8), static_cast<float>(i / 64)});
  }
  expect_equal(points, 8);
  SearchStats stats;
  const std::vector<Neighbour> found = Trees(points).kd_tree->nearest({1, 1, 1}, 7, stats);
  EXPECT_EQ(found.front(), (Neighbour{0, 73}));
  for (std::size_t i = 2; i < found.size(); ++i) {
    EXPECT_EQ(found[i].distance_squared, 1);
    EXPECT_LT(found[i - 1].point, found[i].point);
  }
}

TEST(NearestPoints, DuplicatesAreAllFound) {
  std::vector<Vec3f> points(200, Vec3f{1, 2, 3});
  for (const Vec3f& point : random_points(50)) points.push_back(point);
  expect_equal(points, 4);
}

TEST(NearestPoints, LinesAndPlanesAgree) {
  std::vector<Vec3f> line, slanted, plane;
  Dice dice(3);
  for (int i = 0; i < 200; ++i) {
    const float x = dice.both();
    line.push_back({0, x, 0});
    slanted.push_back({x, 2 * x, -x});
    plane.push_back({x, 5, dice.both()});
  }
  for (const auto& points : {line, slanted, plane}) expect_equal(points, 6);
}

TEST(NearestPoints, FarOffsetsAgree) {
  for (const float offset : {1e6f, 1e12f, 1e18f}) {
    std::vector<Vec3f> points = random_points(200);
    for (Vec3f& point : points) point = point * (offset * 1e-6f) + Vec3f{offset, -offset, offset};
    expect_equal(points, 2 * offset);
  }
}

TEST(NearestPoints, TreesVisitFewOfManyPoints) {
  const std::vector<Vec3f> points = random_points(20'000);
  const Trees trees(points);
  SearchStats kd_tree, bvh;
  for (std::uint32_t i = 0; i < 500; ++i) {
    trees.kd_tree->nearest(points[i], 8, kd_tree);
    trees.bvh->nearest(points[i], 8, bvh);
  }
  EXPECT_LT(kd_tree.points, 500 * 100);
  EXPECT_LT(bvh.points, 500 * 100);
}

}  // namespace
}  // namespace tessera::render::testing
