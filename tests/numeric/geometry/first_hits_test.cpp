// The item buffer and Morton order of tests/bench/accel, which are measured against camera rays.

#include <gtest/gtest.h>

#include <set>

#include "tests/bench/accel/workload/item_buffer.h"
#include "tests/bench/accel/workload/pixel_orders.h"
#include "tests/bench/accel/workload/rays.h"
#include "worker/accel/reference/brute_force.h"
#include "worker/accel/traversal/thread_counts.h"
#include "worker/render/frame_renderer.h"

namespace tessera::render::bench {
namespace {

using contract::GridPoint;

/// Appends the pixels of a square in Z order, by the recursive definition: top left quarter, top
/// right, bottom left, bottom right.
void append_quarters(GridPoint corner, int side, std::vector<GridPoint>& order) {
  if (side == 1) {
    order.push_back(corner);
    return;
  }
  const int half = side / 2;
  for (const GridPoint quarter : {GridPoint{0, 0}, {half, 0}, {0, half}, {half, half}}) {
    append_quarters({corner.x + quarter.x, corner.y + quarter.y}, half, order);
  }
}

TEST(MortonOrder, MatchesRecursiveQuarters) {
  for (int side = 1; side <= 256; side *= 2) {
    std::vector<GridPoint> expected;
    append_quarters({0, 0}, side, expected);
    const std::vector<GridPoint> order = morton_order(side);
    ASSERT_EQ(order.size(), expected.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
      ASSERT_EQ(order[i].x, expected[i].x) << "side " << side << ", pixel " << i;
      ASSERT_EQ(order[i].y, expected[i].y) << "side " << side << ", pixel " << i;
    }
  }
}

TEST(MortonOrder, VisitsEachPixelOnce) {
  for (int side = 1; side <= 128; side *= 2) {
    std::set<std::pair<int, int>> seen;
    for (const GridPoint at : morton_order(side)) {
      ASSERT_TRUE(at.x >= 0 && at.x < side && at.y >= 0 && at.y < side);
      seen.insert({at.x, at.y});
    }
    EXPECT_EQ(seen.size(), static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
  }
}

/// Whether a ray through a point less than 2^-10 pixels from (x, y) first hits `item`. The item
/// buffer projects vertices exactly, while a ray's direction has an error of some 2^-24, which is
/// less than 2^-13 pixels in images of 64 pixels.
bool hits_nearby(const Scene& scene, const View& view, double x, double y, int side,
                 const TriangleId& item) {
  constexpr double kStep = 0x1p-11;
  for (int i = 0; i < 9; ++i) {
    const double u = (x + (i % 3 - 1) * kStep) / side, v = (y + (i / 3 - 1) * kStep) / side;
    Hit hit;
    const bool found =
        brute_force_closest(scene, view.ray(static_cast<float>(u), static_cast<float>(v)), hit);
    if ((found ? hit.id : TriangleId{}) == item) return true;
  }
  return false;
}

TEST(ItemBuffer, MatchesBruteForceAndBvh) {
  constexpr int kSide = 64;
  for (const char* name : {"scan_room", "terrain", "instances", "stadium"}) {
    const BenchScene bench = make_scene(name, true);
    const View view(bench);
    const SceneAccel accel(bench.scene, sequential());
    const std::vector<GridPoint> order = morton_order(kSide);
    const std::vector<Ray> rays = centre_rays(bench, kSide, order);
    const ItemBuffer buffer = item_buffer(bench, kSide);
    int hits = 0, differ = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      Hit hit;
      const bool found = accel.closest_hit(rays[i], hit);
      hits += found ? 1 : 0;
      const TriangleId item =
          buffer.items[static_cast<std::size_t>(order[i].y * kSide + order[i].x)];
      if (item == (found ? hit.id : TriangleId{})) continue;
      ++differ;
      EXPECT_TRUE(hits_nearby(bench.scene, view, order[i].x + 0.5, order[i].y + 0.5, kSide, item))
          << name << ": pixel " << order[i].x << ", " << order[i].y;
    }
    EXPECT_GT(hits, 1000) << name;
    EXPECT_LT(differ, 41) << name << ": 1 % of the pixels";
  }
}

TEST(ItemBuffer, FragmentsEqualDepthComplexity) {
  constexpr int kSide = 32;
  for (const int layers : {1, 7, 50}) {
    const BenchScene bench = make_layers(layers);
    const ItemBuffer buffer = item_buffer(bench, kSide);
    // A square's diagonal passes through pixel centres, which one or both of its triangles cover.
    EXPECT_GE(buffer.fragments, std::int64_t{layers} * kSide * kSide);
    EXPECT_LE(buffer.fragments, std::int64_t{layers} * kSide * (kSide + 1));
    for (const TriangleId& item : buffer.items) EXPECT_LT(item.triangle, 2u) << "nearest layer";
  }
}

/// Nodes visited and triangles tested per ray by the production BVH.
double visits_per_ray(const BenchScene& bench, const std::vector<Ray>& rays) {
  TraceOptions options;
  options.counted = true;
  const SceneAccel accel(bench.scene, sequential(), options);
  const contract::TraversalCounts before = thread_traversal_counts();
  for (const Ray& ray : rays) {
    Hit hit;
    accel.closest_hit(ray, hit);
  }
  const contract::TraversalCounts work = thread_traversal_counts() - before;
  return static_cast<double>(work.nodes + work.primitives) / static_cast<double>(work.rays);
}

TEST(DepthComplexity, CostsBvhLessThanZBuffer) {
  constexpr int kSide = 32;
  double visits[2], fragments[2];
  for (int i = 0; i < 2; ++i) {
    const BenchScene bench = make_layers(i == 0 ? 10 : 1000);
    visits[i] = visits_per_ray(bench, centre_rays(bench, kSide, morton_order(kSide)));
    fragments[i] = static_cast<double>(item_buffer(bench, kSide).fragments);
  }
  EXPECT_LT(visits[1], 3 * visits[0]) << "log 1000 / log 10";
  EXPECT_GT(fragments[1], 90 * fragments[0]) << "1000 / 10";
}

}  // namespace
}  // namespace tessera::render::bench
