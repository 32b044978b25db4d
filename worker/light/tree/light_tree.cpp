#include "worker/light/tree/light_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "worker/accel/layout/lanes.h"
#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kBuckets = 12;

/// Minimum importance relative to the brightest child, even where the bounds say that a light
/// contributes nothing. Bounds are rounded, and a contributing light that is never chosen would be
/// a bias.
constexpr float kFloor = 0x1p-10f;
constexpr double kBelowOne = 1 - 0x1p-53;

Lanes select(Lanes mask, Lanes yes, Lanes no) {
  return _mm256_blendv_ps(no, yes, mask);
}

/// All bits set in the lanes where a > b.
Lanes above(Lanes a, Lanes b) {
  return _mm256_cmp_ps(a, b, _CMP_GT_OQ);
}

/// Sine of an angle in [0, pi] from its cosine, and the inverse up to pi / 2.
Lanes sine_of(Lanes cosine) {
  return _mm256_sqrt_ps(max_lanes(splat(1) - cosine * cosine, splat(0)));
}

/// cos(max(0, a - b)) from the cosines and sines of both angles.
Lanes cos_of_rest(Lanes cos_a, Lanes sin_a, Lanes cos_b, Lanes sin_b) {
  return select(above(cos_a, cos_b), splat(1), cos_a * cos_b + sin_a * sin_b);
}

double angle_between(const Vec3d& a, const Vec3d& b) {
  return elementary::acos(clamp(dot(a, b), -1.0, 1.0));
}

/// A unit vector perpendicular to `axis`.
Vec3d any_perpendicular(const Vec3d& axis) {
  const Vec3d other = std::fabs(axis.x) < 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
  return normalize(cross(axis, other));
}

/// Smallest cone around two cones: rotated from the wider towards the other.
void unite_cones(LightBounds& a, LightBounds b) {
  if (b.normal_angle > a.normal_angle) {
    std::swap(a.axis, b.axis);
    std::swap(a.normal_angle, b.normal_angle);
  }
  if (a.both_sides && b.both_sides && dot(a.axis, b.axis) < 0) b.axis = -b.axis;
  const double between = angle_between(a.axis, b.axis);
  if (std::min(between + b.normal_angle, kPi) <= a.normal_angle) return;
  const double half = 0.5 * (a.normal_angle + between + b.normal_angle);
  if (half >= kPi) {
    a.normal_angle = kPi;
    return;
  }
  const double turn = half - a.normal_angle;
  const Vec3d across = b.axis - a.axis * dot(a.axis, b.axis);
  const double size = length(across);
  const Vec3d side = size > 0 ? across / size : any_perpendicular(a.axis);
  a.axis = normalize(a.axis * elementary::cos(turn) + side * elementary::sin(turn));
  a.normal_angle = half;
}

void unite(LightBounds& a, const LightBounds& b) {
  if (!(a.strength > 0)) {
    a = b;
    return;
  }
  a.box_min = min(a.box_min, b.box_min);
  a.box_max = max(a.box_max, b.box_max);
  unite_cones(a, b);
  // A mix of one-sided and two-sided lights is bounded by emission around all directions.
  if (a.both_sides != b.both_sides) {
    a.both_sides = false;
    a.normal_angle = kPi;
  }
  a.emission_angle = std::max(a.emission_angle, b.emission_angle);
  a.strength += b.strength;
}

/// Integral of the cosine falloff over the directions that a group may light (M_Omega in the
/// paper).
double orientation_measure(const LightBounds& b) {
  const double o = b.normal_angle;
  const double w = std::min(o + b.emission_angle, kPi);
  const double sin_o = elementary::sin(o), cos_o = elementary::cos(o);
  const double measure =
      2 * kPi * (1 - cos_o) +
      0.5 * kPi * (2 * w * sin_o - elementary::cos(o - 2 * w) - 2 * o * sin_o + cos_o);
  return b.both_sides ? 2 * measure : measure;
}

/// Cost of a group in a parent whose box is `extent`; `lengthening` penalises thin boxes along axes
/// other than the split's.
double cost(const LightBounds& b, double lengthening) {
  if (!(b.strength > 0)) return 0;
  const Vec3d d = b.box_max - b.box_min;
  // Squared diagonal instead of the paper's area, which is 0 for collinear lights.
  return b.strength * orientation_measure(b) * lengthening * dot(d, d);
}

}  // namespace

class LightTree::Builder {
 public:
  Builder(const std::vector<LightBounds>& lights, LightTree& tree) : lights_(lights), tree_(tree) {
    for (std::uint32_t i = 0; i < lights.size(); ++i) {
      if (!(lights[i].strength > 0)) continue;
      order_.push_back(i);
      tree.total_ += lights[i].strength;
    }
    tree.leaves_.assign(lights.size(), kNone);
  }

  void build() {
    if (order_.empty()) return;
    build_pairs();
    // Opens the costliest child first. The root is a node even for one light.
    std::vector<std::pair<std::uint32_t, Slot>> open = {{0, kNone}};  // pair and its slot
    for (std::size_t next = 0; next < open.size(); ++next) {
      const auto [root, parent] = open[next];
      const auto index = static_cast<std::uint32_t>(tree_.nodes_.size());
      if (parent != kNone) tree_.nodes_[parent / kWidth].child[parent % kWidth] = index;
      tree_.nodes_.emplace_back();
      tree_.nodes_.back().parent = parent;
      for (const std::uint32_t child : children_of(root)) {
        const Slot slot = add_child(tree_.nodes_.back(), index, pairs_[child]);
        if (pairs_[child].second != kNone) open.emplace_back(child, slot);
      }
    }
  }

 private:
  /// A node of the binary tree; its first child follows it.
  struct Pair {
    LightBounds bounds;
    std::uint32_t second = kNone;  // second child; kNone in leaves
    std::uint32_t light = 0;       // of a leaf
  };

  /// Builds top-down and depth first, with a stack because the tree may be deep.
  void build_pairs() {
    struct Range {
      std::size_t begin, end;
      std::uint32_t parent;  // node of which this is the second child; kNone: a first child
    };
    std::vector<Range> stack = {{0, order_.size(), kNone}};
    while (!stack.empty()) {
      const Range range = stack.back();
      stack.pop_back();
      const auto index = static_cast<std::uint32_t>(pairs_.size());
      if (range.parent != kNone) pairs_[range.parent].second = index;
      pairs_.push_back({bounds_of(range.begin, range.end), kNone, order_[range.begin]});
      if (range.end - range.begin == 1) continue;
      const std::size_t middle = split(range.begin, range.end, pairs_.back().bounds);
      stack.push_back({middle, range.end, index});
      stack.push_back({range.begin, middle, kNone});
    }
  }

  std::vector<std::uint32_t> children_of(std::uint32_t root) const {
    std::vector<std::uint32_t> children = {root};
    while (children.size() < kWidth) {
      std::size_t widest = children.size();
      double max_cost = -1;
      for (std::size_t i = 0; i < children.size(); ++i) {
        const Pair& pair = pairs_[children[i]];
        const double child_cost = pair.second == kNone ? -1 : cost(pair.bounds, 1);
        if (!(child_cost > max_cost)) continue;
        max_cost = child_cost;
        widest = i;
      }
      if (widest == children.size()) break;  // all leaves
      const std::uint32_t opened = children[widest];
      children[widest] = opened + 1;
      children.push_back(pairs_[opened].second);
    }
    return children;
  }

  Slot add_child(Node& node, std::uint32_t index, const Pair& pair) {
    const std::uint32_t lane = node.count++;
    const LightBounds& b = pair.bounds;
    const Vec3f centre((b.box_min + b.box_max) * 0.5), axis(b.axis);
    const Vec3d half = (b.box_max - b.box_min) * 0.5;
    node.centre_x[lane] = centre.x;
    node.centre_y[lane] = centre.y;
    node.centre_z[lane] = centre.z;
    node.radius2[lane] = static_cast<float>(dot(half, half));
    node.axis_x[lane] = axis.x;
    node.axis_y[lane] = axis.y;
    node.axis_z[lane] = axis.z;
    node.cos_normal[lane] = static_cast<float>(elementary::cos(b.normal_angle));
    node.sin_normal[lane] = static_cast<float>(elementary::sin(b.normal_angle));
    // // Slightly widened: for narrow spots, rounding could otherwise exclude their own axis.
    node.cos_emission[lane] = static_cast<float>(elementary::cos(b.emission_angle)) - 0x1p-20f;
    node.both_sides[lane] = b.both_sides ? 1 : 0;
    node.strength[lane] = static_cast<float>(b.strength / tree_.total_);
    const Slot slot = index * static_cast<Slot>(kWidth) + lane;
    if (pair.second == kNone) {
      node.leaves |= 1u << lane;
      node.child[lane] = pair.light;
      tree_.leaves_[pair.light] = slot;
    }
    return slot;
  }

  LightBounds bounds_of(std::size_t begin, std::size_t end) const {
    LightBounds all;
    for (std::size_t i = begin; i < end; ++i) unite(all, lights_[order_[i]]);
    return all;
  }

  Vec3d centre(std::uint32_t light) const {
    return (lights_[light].box_min + lights_[light].box_max) * 0.5;
  }

  /// Splits [begin, end) in two and returns where the second part begins.
  std::size_t split(std::size_t begin, std::size_t end, const LightBounds& bounds) {
    Vec3d low = centre(order_[begin]), high = low;
    for (std::size_t i = begin; i < end; ++i) {
      low = min(low, centre(order_[i]));
      high = max(high, centre(order_[i]));
    }
    const Vec3d extent = bounds.box_max - bounds.box_min;
    const double longest = std::max({extent.x, extent.y, extent.z});
    double min_cost = std::numeric_limits<double>::infinity();
    int best_axis = -1, best_bucket = 0;
    for (int axis = 0; axis < 3; ++axis) {
      if (!(high[axis] > low[axis])) continue;
      const double lengthening = extent[axis] > 0 ? longest / extent[axis] : 1;
      std::array<LightBounds, kBuckets> buckets;
      for (std::size_t i = begin; i < end; ++i) {
        unite(buckets[bucket_of(order_[i], axis, low, high)], lights_[order_[i]]);
      }
      std::array<double, kBuckets> costs{};  // of splitting before each bucket
      LightBounds below, above;
      for (std::size_t b = 1; b < kBuckets; ++b) {
        if (buckets[b - 1].strength > 0) unite(below, buckets[b - 1]);
        costs[b] += cost(below, lengthening);
      }
      for (std::size_t b = kBuckets - 1; b >= 1; --b) {
        if (buckets[b].strength > 0) unite(above, buckets[b]);
        costs[b] += cost(above, lengthening);
      }
      for (int b = 1; b < kBuckets; ++b) {
        if (costs[static_cast<std::size_t>(b)] < min_cost) {
          min_cost = costs[static_cast<std::size_t>(b)];
          best_axis = axis;
          best_bucket = b;
        }
      }
    }
    if (best_axis < 0) return begin + (end - begin) / 2;  // all at one position
    const auto first = order_.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto middle = std::stable_partition(
        first, order_.begin() + static_cast<std::ptrdiff_t>(end), [&](std::uint32_t light) {
          return bucket_of(light, best_axis, low, high) < static_cast<std::size_t>(best_bucket);
        });
    const auto at = static_cast<std::size_t>(middle - order_.begin());
    return at == begin || at == end ? begin + (end - begin) / 2 : at;
  }

  std::size_t bucket_of(std::uint32_t light, int axis, const Vec3d& low, const Vec3d& high) const {
    const double slot = (centre(light)[axis] - low[axis]) / (high[axis] - low[axis]);
    return static_cast<std::size_t>(clamp(slot * kBuckets, 0.0, kBuckets - 1.0));
  }

  const std::vector<LightBounds>& lights_;
  LightTree& tree_;
  std::vector<std::uint32_t> order_;
  std::vector<Pair> pairs_;
};

LightTree::LightTree(const std::vector<LightBounds>& lights) {
  Builder(lights, *this).build();
}

/// Importance of eight children: strength over squared distance, times the maximum cosines that the
/// bounds allow at the light and at the shading point (equation 3 of the paper).
void LightTree::importances(const Node& node, const LightSampleContext& context, LaneArray& out) {
  const Lanes one = splat(1), min_cost = splat(std::numeric_limits<float>::min());
  const Lanes x = load(node.centre_x.data()) - splat(context.point.x);
  const Lanes y = load(node.centre_y.data()) - splat(context.point.y);
  const Lanes z = load(node.centre_z.data()) - splat(context.point.z);
  const Lanes d2 = x * x + y * y + z * z, radius2 = load(node.radius2.data());
  const Lanes outside = above(d2, radius2);
  const Lanes safe_d2 = select(outside, d2, one);
  const Lanes scale = one / _mm256_sqrt_ps(safe_d2);

  // Angles as cosine and sine: w between the axis and the direction to the shading point, n of
  // the normal cone, b of the bounding sphere seen from the shading point, i at the shading point.
  const Lanes towards =
      load(node.axis_x.data()) * x + load(node.axis_y.data()) * y + load(node.axis_z.data()) * z;
  const Lanes along = splat(0) - towards * scale;
  const Lanes size = max_lanes(along, splat(0) - along);
  const Lanes cos_w = select(above(load(node.both_sides.data()), splat(0)), size, along);
  const Lanes sin_w = sine_of(cos_w);
  const Lanes cos_n = load(node.cos_normal.data()), sin_n = load(node.sin_normal.data());
  const Lanes sin_b = _mm256_sqrt_ps(radius2 / safe_d2), cos_b = sine_of(sin_b);

  // cos(max(0, w - n - b)) and cos(max(0, i - b)).
  const Lanes in_cone = above(cos_w, cos_n);
  const Lanes cos_x = select(in_cone, one, cos_w * cos_n + sin_w * sin_n);
  const Lanes sin_x = select(in_cone, splat(0), sin_w * cos_n - cos_w * sin_n);
  const Lanes at_light = cos_of_rest(cos_x, sin_x, cos_b, sin_b);
  const Lanes cos_i =
      (splat(context.normal.x) * x + splat(context.normal.y) * y + splat(context.normal.z) * z) *
      scale;
  const Lanes facing = cos_of_rest(cos_i, sine_of(cos_i), cos_b, sin_b);

  const Lanes emits = at_least(at_light, load(node.cos_emission.data()));
  const Lanes given = max_lanes(_mm256_and_ps(emits, at_light), splat(kFloor));
  const Lanes taken = max_lanes(facing, splat(context.every_side ? 1 : kFloor));
  const Lanes share = select(outside, given * taken, one);
  const Lanes reach2 = max_lanes(select(outside, d2, radius2), min_cost);
  _mm256_store_ps(out.data(), load(node.strength.data()) * share / reach2);
}

LightTree::Weights LightTree::weights(const Node& node, const LightSampleContext& context) {
  alignas(32) LaneArray importance;
  importances(node, context, importance);
  double total = 0;
  for (std::size_t i = 0; i < node.count; ++i) total += static_cast<double>(importance[i]);
  // Clamped so that no child vanishes through rounding.
  const double min_cost = total > 0 ? total * 0x1p-20 : 1;
  Weights sums{};
  for (std::size_t i = 0; i < node.count; ++i) {
    sums[i + 1] = sums[i] + (static_cast<double>(importance[i]) + min_cost);
  }
  return sums;
}

LightTree::Choice LightTree::choose(const LightSampleContext& context, double u) const {
  if (nodes_.size() == 1 && nodes_[0].count == 1) return {nodes_[0].child[0], 1};
  Choice choice{0, 1};
  for (std::uint32_t at = 0;;) {
    const Node& node = nodes_[at];
    const Weights sums = weights(node, context);
    const double total = sums[node.count], target = u * total;
    std::size_t lane = 0;
    while (lane + 1 < node.count && !(target < sums[lane + 1])) ++lane;
    const double weight = sums[lane + 1] - sums[lane];
    choice.probability *= weight / total;
    if ((node.leaves >> lane & 1) != 0) {
      choice.light = node.child[lane];
      return choice;
    }
    u = clamp((target - sums[lane]) / weight, 0.0, kBelowOne);
    at = node.child[lane];
  }
}

double LightTree::probability(const LightSampleContext& context, std::uint32_t light) const {
  Slot slot = leaves_[light];
  if (slot == kNone) return 0;
  if (nodes_.size() == 1 && nodes_[0].count == 1) return 1;
  double probability = 1;
  for (; slot != kNone; slot = nodes_[slot / kWidth].parent) {
    const Node& node = nodes_[slot / kWidth];
    const Weights sums = weights(node, context);
    const std::size_t lane = slot % kWidth;
    probability *= (sums[lane + 1] - sums[lane]) / sums[node.count];
  }
  return probability;
}

double LightTree::importance(const LightSampleContext& context) const {
  if (empty()) return 0;
  alignas(32) LaneArray importance;
  importances(nodes_[0], context, importance);
  double sum = 0;
  for (const float i : importance) sum += static_cast<double>(i);
  return total_ * sum;
}

std::int64_t LightTree::memory_bytes() const {
  return static_cast<std::int64_t>(nodes_.size() * sizeof(Node) + leaves_.size() * sizeof(Slot));
}

}  // namespace tessera::render
