#include "worker/guide/direction_tree.h"

#include <algorithm>

namespace tessera::render {
namespace {

constexpr int kBits = 15;  // of a coordinate
constexpr int kMaxDivisions = 11;
/// A quadrant with fewer points or less of the whole weight is not divided. Measured:
/// docs/notes/guiding.md.
constexpr std::size_t kMinPoints = 8;
constexpr double kMinWeight = 1.0 / 128;
constexpr float kBelowOne = 1 - 0x1p-24f;

/// Moves bit i to bit 2 i.
std::uint32_t spread_bits(std::uint32_t x) {
  x = (x | (x << 8)) & 0x00ff00ffu;
  x = (x | (x << 4)) & 0x0f0f0f0fu;
  x = (x | (x << 2)) & 0x33333333u;
  return (x | (x << 1)) & 0x55555555u;
}

/// Builds the tree over sorted points.
class TreeBuilder {
 public:
  explicit TreeBuilder(std::span<const DirectionPoint> points) : points_(points) {
    sums_.reserve(points.size() + 1);
    double sum = 0;
    sums_.push_back(0);
    for (const DirectionPoint& point : points) sums_.push_back(sum += double{point.weight});
  }

  std::vector<DirectionNode> build() {
    nodes_.emplace_back();
    divide(0, {0, points_.size()}, 0, 0);
    return std::move(nodes_);
  }

 private:
  struct Range {
    std::size_t first, last;
  };
  double weight(const Range& r) const { return sums_[r.last] - sums_[r.first]; }

  /// `code`: the lowest one in the square of `node`, which is `depth` divisions below the whole.
  void divide(std::size_t node, const Range& range, std::uint32_t code, int depth) {
    const int shift = 2 * (kBits - 1 - depth);
    const double whole = weight(range);
    const double more = 0.5 * whole / static_cast<double>(range.last - range.first);
    std::size_t first = range.first;
    for (std::uint32_t q = 0; q < 4; ++q) {
      const std::uint32_t end = code + ((q + 1) << shift);
      const auto found =
          std::partition_point(points_.begin() + static_cast<std::ptrdiff_t>(first),
                               points_.begin() + static_cast<std::ptrdiff_t>(range.last),
                               [&](const DirectionPoint& point) { return point.code < end; });
      const Range part{first, static_cast<std::size_t>(found - points_.begin())};
      first = part.last;
      nodes_[node].share[q] = static_cast<float>((weight(part) + more) / (whole + 4 * more));
      const bool divides = depth + 1 < kMaxDivisions && part.last - part.first >= kMinPoints &&
                           weight(part) >= kMinWeight * sums_.back();
      if (!divides) continue;
      const std::size_t child = nodes_.size();
      nodes_.emplace_back();
      nodes_[node].child[q] = static_cast<std::uint32_t>(child);
      divide(child, part, code + (q << shift), depth + 1);
    }
  }

  std::span<const DirectionPoint> points_;
  std::vector<double> sums_;  // of the weights of the first i points
  std::vector<DirectionNode> nodes_;
};

/// Chooses the second half with probability 1 - first and rescales u within the chosen half.
std::size_t choose_half(float first, float* u) {
  const bool second = !(*u < first);
  const float rescaled = second ? (*u - first) / (1 - first) : *u / first;
  *u = rescaled < kBelowOne ? rescaled : kBelowOne;
  return second ? 1 : 0;
}

}  // namespace

std::uint32_t direction_code(const Vec2f& p) {
  constexpr float kSteps = 1 << kBits;
  const auto cell = [](float x) { return static_cast<std::uint32_t>(x * kSteps); };
  return spread_bits(cell(p.y)) << 1 | spread_bits(cell(p.x));
}

std::vector<DirectionNode> build_direction_tree(std::span<DirectionPoint> points) {
  std::sort(points.begin(), points.end(), [](const DirectionPoint& a, const DirectionPoint& b) {
    return a.code != b.code ? a.code < b.code : a.weight < b.weight;
  });
  return TreeBuilder(points).build();
}

Vec2f sample_direction_tree(const DirectionNode* tree, Vec2f u) {
  Vec2f corner;
  float side = 1;
  std::uint32_t index = 0;
  do {
    const DirectionNode& node = tree[index];
    side *= 0.5f;
    const float left = node.share[0] + node.share[2];
    const std::size_t right = choose_half(left, &u.x);
    const float lower = node.share[right], upper = node.share[2 + right];
    const std::size_t quadrant = 2 * choose_half(lower / (lower + upper), &u.y) + right;
    if (right != 0) corner.x += side;
    if (quadrant >= 2) corner.y += side;
    index = node.child[quadrant];
  } while (index != 0);
  return {corner.x + side * u.x, corner.y + side * u.y};
}

float direction_tree_density(const DirectionNode* tree, Vec2f p) {
  float density = 1;
  std::uint32_t index = 0;
  do {
    const DirectionNode& node = tree[index];
    p = {2 * p.x, 2 * p.y};
    std::size_t quadrant = 0;
    if (p.x >= 1) {
      p.x -= 1;
      quadrant = 1;
    }
    if (p.y >= 1) {
      p.y -= 1;
      quadrant += 2;
    }
    density *= 4 * node.share[quadrant];
    index = node.child[quadrant];
  } while (index != 0);
  return density;
}

}  // namespace tessera::render
