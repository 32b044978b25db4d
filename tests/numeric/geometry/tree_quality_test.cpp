// Quality of trees: all build qualities give the same hits, reinsertion makes trees cheaper, and
// the quality measures match values calculated by hand.

#include "worker/accel/build/tree_quality.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "worker/accel/binary_bvh/reinsertion.h"
#include "worker/accel/build/mesh_bvh.h"
#include "worker/accel/build/wide_bvh.h"
#include "worker/accel/reference/brute_force.h"

namespace tessera::render::testing {
namespace {

double summed_area(const BinaryBvh& bvh) {
  double sum = 0;
  for (const BinaryNode& node : bvh.nodes) sum += node.leaf() ? 0 : node.box.half_area();
  return sum;
}

int levels(const BinaryBvh& bvh, std::uint32_t index) {
  const BinaryNode& node = bvh.nodes[index];
  return node.leaf() ? 1 : 1 + std::max(levels(bvh, node.left), levels(bvh, node.right));
}

std::vector<Box3f> boxes_of_needles(int count, Dice& dice) {
  std::vector<Box3f> boxes;
  for (int i = 0; i < count; ++i) {
    const Vec3f p = dice.vector(), size = {dice.unit() * dice.unit(), 0.01f, dice.unit() * 0.1f};
    boxes.push_back({p, p + size});
  }
  return boxes;
}

/// Expects every inner node to have the box of its children, which follow it, and every item to be
/// in one leaf.
void expect_sound(const BinaryBvh& bvh, std::size_t items) {
  std::vector<int> seen(items, 0);
  for (std::uint32_t i = 0; i < bvh.nodes.size(); ++i) {
    const BinaryNode& node = bvh.nodes[i];
    if (node.leaf()) {
      for (std::uint32_t k = 0; k < node.count; ++k) ++seen[bvh.order[node.first + k]];
      continue;
    }
    ASSERT_GT(node.left, i);
    ASSERT_GT(node.right, i);
    Box3f both = bvh.nodes[node.left].box;
    both.extend(bvh.nodes[node.right].box);
    ASSERT_EQ(both, node.box);
  }
  EXPECT_TRUE(std::all_of(seen.begin(), seen.end(), [](int n) { return n == 1; }));
}

TEST(Reinsertion, ReducesTreeCost) {
  Dice dice(1);
  const std::vector<Box3f> boxes = boxes_of_needles(4'000, dice);
  const BinaryBvh before = build_binary_bvh({boxes}, in_order());
  BinaryBvh after = before;
  reinsert_subtrees(after, 2);
  expect_sound(after, boxes.size());
  EXPECT_LE(levels(after, 0), kMaxLevels);
  EXPECT_LT(summed_area(after), 0.98 * summed_area(before));
}

TEST(Reinsertion, RespectsDepthLimit) {
  // A chain of nested boxes of maximum depth with a leaf beside each, and in another branch a leaf
  // that belongs into the innermost box, one level below.
  BinaryBvh bvh;
  const auto leaf = [&](const Vec3f& lo, const Vec3f& hi) {
    BinaryNode node;
    node.box = {lo, hi};
    node.first = static_cast<std::uint32_t>(bvh.order.size());
    node.count = 1;
    bvh.order.push_back(node.first);
    return node;
  };
  const auto inner = [&](const Box3f& box, std::uint32_t left, std::uint32_t right) {
    BinaryNode node;
    node.box = box;
    node.left = left;
    node.right = right;
    return node;
  };
  const float innermost = std::ldexp(1.0f, 2 - kMaxLevels);
  bvh.nodes.push_back(inner({{0, 0, 0}, {9, 9, 9}}, 1, 4));
  bvh.nodes.push_back(inner({{0, 0, 0}, {9, 9, 9}}, 2, 3));
  bvh.nodes.push_back(leaf({0, 0, 0}, {innermost, innermost, innermost}));
  bvh.nodes.push_back(leaf({8, 8, 8}, {9, 9, 9}));
  for (int level = 2; level < kMaxLevels; ++level) {
    const float size = std::ldexp(1.0f, 2 - level);
    const auto index = static_cast<std::uint32_t>(bvh.nodes.size());
    bvh.nodes.push_back(inner({{0, 0, 0}, {size, size, size}}, index + 2, index + 1));
    bvh.nodes.push_back(leaf({0.9f * size, 0.9f * size, 0.9f * size}, {size, size, size}));
  }
  bvh.nodes.push_back(leaf({0, 0, 0}, {innermost, innermost, innermost}));
  ASSERT_EQ(levels(bvh, 0), kMaxLevels);
  const std::vector<BinaryNode> before = bvh.nodes;
  reinsert_subtrees(bvh, 1);
  EXPECT_EQ(levels(bvh, 0), kMaxLevels);
  EXPECT_EQ(bvh.nodes.size(), before.size());
}

TEST(BuildQuality, ChangesTreesButNoHits) {
  Dice dice(2);
  const Scene scene = scene_of({needles(3'000, dice)});
  const SceneAccel normal(scene, in_order());
  const SceneAccel fast(scene, in_order(), best_isa(), nullptr, BuildQuality::fast);
  const SceneAccel high(scene, in_order(), best_isa(), nullptr, BuildQuality::high);
  EXPECT_LT(fast.memory_bytes(), normal.memory_bytes()) << "the test needs split triangles";
  EXPECT_LT(high.tree_quality().sah, normal.tree_quality().sah);
  int hits = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Ray ray = adversarial_ray(scene, dice);
    Hit a, b, c;
    const bool found = normal.closest_hit(ray, a);
    ASSERT_EQ(fast.closest_hit(ray, b), found);
    ASSERT_EQ(high.closest_hit(ray, c), found);
    ASSERT_TRUE(!found || (same_bits(a, b) && same_bits(a, c)));
    hits += found ? 1 : 0;
  }
  EXPECT_GT(hits, 5'000);
}

TEST(TreeQuality, TwoTrianglesMatchHandCalculation) {
  MeshBvh<8> tree;
  tree.nodes = HugeArray<WideNode<8>>(1);
  tree.blocks = HugeArray<TriangleBlock>(2);
  tree.blocks[0].set(0, {Vec3f{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, 0);
  tree.blocks[1].set(0, {Vec3f{0, 0, -1}, {0.5f, 0, 1}, {0, 2, 0}}, 1);
  tree.nodes[0].set_child(0, {{0, 0, 0}, {1, 1, 0}}, kLeafBit | 0u);
  tree.nodes[0].set_child(1, {{0, 0, -1}, {0.5f, 2, 1}}, kLeafBit | 1u);
  tree.bounds = {{0, 0, -1}, {1, 2, 1}};
  tree.first_rank = {0, 2};
  const TreeQuality quality = measure_tree_quality(tree);
  // Half areas: 1 and 6 of 8. The part of the first triangle with x <= 1/2 lies in the second's
  // box; the second only crosses the first's flat box.
  EXPECT_DOUBLE_EQ(quality.sah, 1 + 7.0 / 8);
  const double first = 0.5, second = 0.5 * std::sqrt(16 + 0.25 + 1);
  EXPECT_NEAR(quality.end_point_overlap, 0.375 / (first + second), 1e-15);
}

/// Moves every vertex a little.
Primitive moved(Primitive p, float by, Dice& dice) {
  for (Vec3f& position : p.positions) position += dice.vector() * by;
  return p;
}

/// Counts rays whose hits in the BVH of `now`, refitted from that of `before`, differ from brute
/// force.
int mismatches_after(const Scene& before, const Scene& now, std::size_t expected_refits,
                     Dice& dice) {
  int wrong = 0;
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!is_supported(isa)) continue;
    const SceneAccel old(before, in_order(), isa);
    const SceneAccel accel(now, in_order(), isa, &old);
    EXPECT_EQ(accel.refitted_meshes(), expected_refits);
    for (int i = 0; i < 4'000; ++i) {
      const Ray ray = adversarial_ray(now, dice);
      Hit fast, slow;
      const bool found = brute_force_closest(now, ray, slow);
      if (accel.closest_hit(ray, fast) != found || (found && !same_bits(fast, slow))) ++wrong;
    }
  }
  return wrong;
}

TEST(Refit, MovedTrianglesMatchBruteForce) {
  Dice dice(3);
  const Primitive start = terrain(24, dice);
  EXPECT_EQ(mismatches_after(scene_of({start}), scene_of({moved(start, 1e-3f, dice)}), 1, dice), 0);
  Dice stretch(4);
  Primitive stretched = start;
  for (Vec3f& p : stretched.positions) p = p * Vec3f{3, 3, 3} + Vec3f{100, 0, 0};
  EXPECT_EQ(mismatches_after(scene_of({start}), scene_of({stretched}), 1, stretch), 0);
}

TEST(Refit, LargeMotionRebuilds) {
  Dice dice(5);
  const Primitive start = terrain(24, dice);
  EXPECT_EQ(mismatches_after(scene_of({start}), scene_of({moved(start, 1, dice)}), 0, dice), 0);
}

TEST(Refit, ChangedTriangleSetRebuilds) {
  Dice dice(6);
  const Primitive whole = soup(40, dice);
  // A triangle becomes degenerate or stops being so, one replaces another, or the count changes.
  Primitive without = whole;
  without.positions[without.triangles[3][1]] = without.positions[without.triangles[3][0]];
  without.positions[without.triangles[3][2]] = without.positions[without.triangles[3][0]];
  Primitive other = whole;
  other.positions[other.triangles[7][1]] = other.positions[other.triangles[7][0]];
  other.positions[other.triangles[7][2]] = other.positions[other.triangles[7][0]];
  EXPECT_EQ(mismatches_after(scene_of({whole}), scene_of({without}), 0, dice), 0);
  EXPECT_EQ(mismatches_after(scene_of({without}), scene_of({whole}), 0, dice), 0);
  EXPECT_EQ(mismatches_after(scene_of({without}), scene_of({other}), 0, dice), 0);
  EXPECT_EQ(mismatches_after(scene_of({whole}), scene_of({whole, soup(3, dice)}), 0, dice), 0);
  EXPECT_EQ(mismatches_after(scene_of({soup(3, dice)}), scene_of({whole}), 0, dice), 0);
}

}  // namespace
}  // namespace tessera::render::testing
