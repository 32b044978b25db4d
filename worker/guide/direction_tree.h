#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "worker/math/vector.h"

namespace tessera::render {

/// A node of a quadtree that describes a density on the unit square, which is uniform in each leaf.
/// A tree is an array of nodes that starts with its root. Source: Müller, Gross & Novák, "Practical
/// path guiding for efficient light-transport simulation", 2017.
struct DirectionNode {
  /// Share of the node's probability in each quadrant, above 0; index 2 * (y >= 1/2) + (x >= 1/2).
  std::array<float, 4> share{};
  std::array<std::uint32_t, 4> child{};  // index of the node in the tree; 0: a leaf
};

/// A weighted point of the square.
struct DirectionPoint {
  std::uint32_t code = 0;  // direction_code()
  float weight = 0;        // at least 0
};

/// Interleaved bits of a point in [0, 1)^2, 15 for each coordinate.
std::uint32_t direction_code(const Vec2f& p);

/// Builds a tree for points; the result does not depend on their order, but sorts them. A quadrant
/// is divided while it has enough points and weight. Requires a positive total weight.
///
/// Each quadrant's share is a weighted count with half a point of mean weight added, so that none
/// is empty because no point happened to fall there.
std::vector<DirectionNode> build_direction_tree(std::span<DirectionPoint> points);

/// Point of a tree's density for u in [0, 1)^2, by warps that preserve stratification.
Vec2f sample_direction_tree(const DirectionNode* tree, Vec2f u);

/// Density of a tree at a point in [0, 1)^2.
float direction_tree_density(const DirectionNode* tree, Vec2f p);

}  // namespace tessera::render
