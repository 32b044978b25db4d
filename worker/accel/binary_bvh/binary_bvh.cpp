#include "worker/accel/binary_bvh/binary_bvh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "worker/accel/layout/packed_box.h"
#include "worker/math/float_bits.h"

namespace tessera::render {
namespace {

constexpr int kBins = 32, kSplitBins = 16;
/// From this depth on nodes are split by count, which adds at most 31 levels.
constexpr int kMaxSahDepth = 40;
/// Ranges larger than this are split sequentially, smaller ones in parallel.
constexpr std::uint32_t kParallelRange = 1u << 13;
/// Spatial splits are tried if the children overlap by more than this fraction of the root's area
/// (Stich 2009).
constexpr double kSplitOverlap = 1e-5;

/// An item, or a part of one.
struct alignas(32) Reference {
  Vec3f lo;
  std::uint32_t id;
  Vec3f negated_hi;
  std::uint32_t unused;

  Reference() = default;
  Reference(const Box3f& box, std::uint32_t item)
      : lo(box.lo), id(item), negated_hi(-box.hi), unused(0) {}
  __m256 lanes() const { return _mm256_load_ps(&lo.x); }
  PackedBox packed() const { return PackedBox(lanes()); }
  Box3f box() const { return {lo, -negated_hi}; }
  /// Twice the centre; the fourth lane is undefined.
  __m128 centre() const {
    return _mm_sub_ps(_mm256_castps256_ps128(lanes()), _mm256_extractf128_ps(lanes(), 1));
  }
  float centre(int axis) const { return lo[axis] - negated_hi[axis]; }
};

struct Bin {
  PackedBox box;
  std::uint32_t count = 0;
};

/// For each slab, the box of the parts of references in it and the numbers of references that begin
/// and end in it.
struct SlabBins {
  PackedBox boxes[kSplitBins];
  std::uint32_t entries[kSplitBins] = {}, exits[kSplitBins] = {};
};

/// A split of a node. The left child gets the references in bins below `bin` or, for a spatial
/// split, the parts of references below `plane`.
struct Split {
  int axis = -1;
  int bin = 0;
  double cost = 0;
  bool spatial = false;
  float plane = 0;
};

/// References [first, first + count) of one node, followed by space for `room` more, which spatial
/// splits may add.
struct Task {
  std::uint32_t first = 0, count = 0, room = 0;
  int depth = 0;
};

/// Maps centres to bins along all axes at once. The scale of an axis along which all centres
/// (nearly) coincide is 0.
struct BinScale {
  __m128 low, scale;

  explicit BinScale(const Box3f& centres) {
    alignas(16) float s[4] = {};
    for (int k = 0; k < 3; ++k) {
      const float size = centres.hi[k] - centres.lo[k];
      const float x = static_cast<float>(kBins) / size;
      s[k] = size > 0 && x < std::numeric_limits<float>::max() ? x : 0.0f;
    }
    low = _mm_setr_ps(centres.lo.x, centres.lo.y, centres.lo.z, 0);
    scale = _mm_load_ps(s);
  }
  __m128i bins(const Reference& r) const {
    const __m128 x = _mm_mul_ps(_mm_sub_ps(r.centre(), low), scale);
    const __m128 top = _mm_set1_ps(static_cast<float>(kBins - 1));
    return _mm_cvttps_epi32(_mm_min_ps(_mm_max_ps(x, _mm_setzero_ps()), top));
  }
  int bin(const Reference& r, int axis) const {
    alignas(16) std::int32_t b[4];
    _mm_store_si128(reinterpret_cast<__m128i*>(b), bins(r));
    return b[axis];
  }
  bool usable(int axis) const {
    alignas(16) float s[4];
    _mm_store_ps(s, scale);
    return s[axis] > 0;
  }
};

struct Bounds {
  Box3f box, centres;
};

Bounds bounds_of(std::span<const Reference> range) {
  PackedBox box;
  __m128 lo = _mm_set1_ps(std::numeric_limits<float>::infinity());
  __m128 hi = _mm_set1_ps(-std::numeric_limits<float>::infinity());
  for (const Reference& r : range) {
    box.extend(r.packed());
    lo = _mm_min_ps(lo, r.centre());
    hi = _mm_max_ps(hi, r.centre());
  }
  alignas(16) float l[4], h[4];
  _mm_store_ps(l, lo);
  _mm_store_ps(h, hi);
  return {box.box(), {{l[0], l[1], l[2]}, {h[0], h[1], h[2]}}};
}

Box3f intersection(const Box3f& a, const Box3f& b) {
  return {max(a.lo, b.lo), min(a.hi, b.hi)};
}

/// Widens the box of a part of an item by two ulps, for the rounding of clip().
Box3f widened(Box3f box) {
  for (int k = 0; k < 3; ++k) {
    box.lo[k] = next_down(next_down(box.lo[k]));
    box.hi[k] = next_up(next_up(box.hi[k]));
  }
  return box;
}

class Builder {
 public:
  Builder(std::span<Reference> references, const BinaryBvhInput& input)
      : references_(references), input_(input) {}

  void set_root_area(double area) { root_area_ = area; }

  /// Splits nodes[index] and appends its children to `nodes`, or makes it a leaf and returns false
  /// if that costs less. `tasks` is parallel to `nodes`.
  bool divide(std::vector<BinaryNode>& nodes, std::vector<Task>& tasks, std::uint32_t index) const {
    const Task task = tasks[index];
    const std::span<Reference> range = references_.subspan(task.first, task.count);
    const Bounds bounds = bounds_of(range);
    nodes[index].box = bounds.box;
    const Split split = choose(task, range, bounds);
    const double area = bounds.box.half_area();
    if (task.count <= input_.leaf_size && !(split.axis >= 0 && split.cost < 0.6 * area)) {
      nodes[index].first = task.first;
      nodes[index].count = task.count;
      return false;
    }
    std::array<Task, 2> children;
    if (split.spatial) {
      children = split_space(task, split);
    } else {
      children = split_objects(task, range, bounds, split);
    }
    nodes[index].left = static_cast<std::uint32_t>(nodes.size());
    nodes[index].right = nodes[index].left + 1;
    nodes.resize(nodes.size() + 2);
    tasks.insert(tasks.end(), children.begin(), children.end());
    return true;
  }

  /// Builds the whole tree below `root`, which is element 0; indices are relative to the result.
  std::vector<BinaryNode> build(const Task& root) const {
    std::vector<BinaryNode> nodes(1);
    std::vector<Task> tasks = {root};
    for (std::uint32_t i = 0; i < nodes.size(); ++i) divide(nodes, tasks, i);
    return nodes;
  }

 private:
  Split choose(const Task& task, std::span<const Reference> range, const Bounds& bounds) const {
    if (task.depth >= kMaxSahDepth || task.count <= 1) return {};
    Box3f overlap;
    Split best = best_object_split(range, BinScale(bounds.centres), overlap);
    if (input_.cut == nullptr || task.room == 0 || task.count <= input_.leaf_size) return best;
    if (best.axis >= 0 && !(overlap.half_area() > kSplitOverlap * root_area_)) return best;
    best_spatial_split(task, range, bounds.box, best);
    return best;
  }

  /// Returns the best split by binned centres. The cost is the sum over both children of half area
  /// times leaf tests.
  Split best_object_split(std::span<const Reference> range, const BinScale& scale,
                          Box3f& overlap) const {
    Bin bins[3][kBins];
    for (const Reference& r : range) {
      alignas(16) std::int32_t b[4];
      _mm_store_si128(reinterpret_cast<__m128i*>(b), scale.bins(r));
      for (int axis = 0; axis < 3; ++axis) {
        Bin& bin = bins[axis][b[axis]];
        bin.box.extend(r.packed());
        ++bin.count;
      }
    }
    Split best;
    for (int axis = 0; axis < 3; ++axis) {
      if (scale.usable(axis)) sweep(bins[axis], axis, best);
    }
    if (best.axis < 0) return best;
    PackedBox left, right;
    for (int i = 0; i < kBins; ++i) {
      (i < best.bin ? left : right).extend(bins[best.axis][i].box);
    }
    overlap = left.intersect(right).box();
    return best;
  }

  void sweep(const Bin* bins, int axis, Split& best) const {
    double right_cost[kBins];
    std::uint32_t right_count[kBins];
    Bin sum;
    for (int i = kBins - 1; i > 0; --i) {
      sum.box.extend(bins[i].box);
      sum.count += bins[i].count;
      right_count[i] = sum.count;
      right_cost[i] = sum.box.half_area() * leaf_tests(sum.count);
    }
    Bin left;
    for (int i = 1; i < kBins; ++i) {
      left.box.extend(bins[i - 1].box);
      left.count += bins[i - 1].count;
      if (left.count == 0 || right_count[i] == 0) continue;
      const double cost = left.box.half_area() * leaf_tests(left.count) + right_cost[i];
      if (best.axis < 0 || cost < best.cost) best = {axis, i, cost, false, 0};
    }
  }

  /// Replaces `best` by a spatial split that is cheaper and fits into `task.room`, if there is one.
  void best_spatial_split(const Task& task, std::span<const Reference> range, const Box3f& box,
                          Split& best) const {
    const Vec3f size = box.hi - box.lo;
    const float longest = max_abs(size);
    for (int axis = 0; axis < 3; ++axis) {
      if (size[axis] >= 0.5f * longest) spatial_sweep(task, range, box, axis, best);
    }
  }

  void spatial_sweep(const Task& task, std::span<const Reference> range, const Box3f& box, int axis,
                     Split& best) const {
    const float low = box.lo[axis], width = (box.hi[axis] - low) / kSplitBins;
    float planes[kSplitBins + 1];
    for (int i = 0; i <= kSplitBins; ++i) planes[i] = low + width * static_cast<float>(i);
    planes[kSplitBins] = box.hi[axis];
    if (!(planes[1] > low) || !(planes[kSplitBins - 1] < box.hi[axis])) return;
    const auto bin_of = [&](float x) {
      return static_cast<int>(clamp((x - low) / width, 0.0f, static_cast<float>(kSplitBins - 1)));
    };
    SlabBins bins;
    for (const Reference& r : range) {
      const int from = bin_of(r.lo[axis]), to = bin_of(-r.negated_hi[axis]);
      ++bins.entries[from];
      ++bins.exits[to];
      if (from == to) {
        bins.boxes[from].extend(r.packed());
        continue;
      }
      PackedBox parts[kSplitBins];
      input_.cut->chop(r.id, {axis, std::span(planes).subspan(from, to - from + 2)}, parts);
      for (int i = from; i <= to; ++i) {
        const PackedBox part = parts[i - from].intersect(r.packed());
        if (!part.empty()) bins.boxes[i].extend(part);
      }
    }
    sweep_parts(task, bins, axis, planes, best);
  }

  void sweep_parts(const Task& task, const SlabBins& bins, int axis, const float* planes,
                   Split& best) const {
    double right_cost[kSplitBins];
    std::uint32_t right_count[kSplitBins];
    PackedBox sum;
    std::uint32_t count = 0;
    for (int i = kSplitBins - 1; i > 0; --i) {
      sum.extend(bins.boxes[i]);
      count += bins.exits[i];
      right_count[i] = count;
      right_cost[i] = sum.half_area() * leaf_tests(count);
    }
    PackedBox left;
    std::uint32_t left_count = 0;
    for (int i = 1; i < kSplitBins; ++i) {
      left.extend(bins.boxes[i - 1]);
      left_count += bins.entries[i - 1];
      if (left_count == 0 || right_count[i] == 0) continue;
      if (left_count + right_count[i] > task.count + task.room) continue;
      if (left_count == task.count && right_count[i] == task.count) continue;
      const double cost = left.half_area() * leaf_tests(left_count) + right_cost[i];
      if (best.axis < 0 || cost < best.cost) best = {axis, 0, cost, true, planes[i]};
    }
  }

  double leaf_tests(std::uint32_t count) const {
    const std::uint32_t tests = (count + input_.leaf_size - 1) / input_.leaf_size;
    return static_cast<double>(tests);
  }

  std::array<Task, 2> split_objects(const Task& task, std::span<Reference> range,
                                    const Bounds& bounds, const Split& split) const {
    std::uint32_t left = 0;
    if (split.axis < 0) {
      left = split_by_count(range, bounds.centres);
    } else {
      const BinScale scale(bounds.centres);
      const auto middle = std::partition(range.begin(), range.end(), [&](const Reference& r) {
        return scale.bin(r, split.axis) < split.bin;
      });
      left = static_cast<std::uint32_t>(middle - range.begin());
    }
    return share_room(task, left, task.count - left, task.room);
  }

  /// Splits references that straddle the plane; appends their right parts behind the last
  /// reference.
  std::array<Task, 2> split_space(const Task& task, const Split& split) const {
    constexpr float kInf = std::numeric_limits<float>::infinity();
    const int axis = split.axis;
    std::uint32_t end = task.first + task.count;
    for (std::uint32_t i = task.first; i < task.first + task.count; ++i) {
      Reference& r = references_[i];
      if (!(r.lo[axis] < split.plane && -r.negated_hi[axis] > split.plane)) continue;
      const Box3f whole = r.box();
      const Box3f below =
          intersection(widened(input_.cut->clip(r.id, axis, -kInf, split.plane)), whole);
      const Box3f above =
          intersection(widened(input_.cut->clip(r.id, axis, split.plane, kInf)), whole);
      if (below.empty() || above.empty() || end == task.first + task.count + task.room) continue;
      r = Reference(below, r.id);
      references_[end++] = Reference(above, r.id);
    }
    const std::span<Reference> range = references_.subspan(task.first, end - task.first);
    // A part lies on its side of the plane, except for the widening.
    const auto middle = std::partition(range.begin(), range.end(), [&](const Reference& r) {
      return r.centre(axis) < 2 * split.plane;
    });
    auto left = static_cast<std::uint32_t>(middle - range.begin());
    const auto count = static_cast<std::uint32_t>(range.size());
    if (left == 0 || left == count) left = split_by_count(range, bounds_of(range).centres);
    return share_room(task, left, count - left, task.room - (count - task.count));
  }

  /// Divides the room between the children in proportion to their references, and moves the right
  /// child's references behind the left child's room.
  std::array<Task, 2> share_room(const Task& task, std::uint32_t left, std::uint32_t right,
                                 std::uint32_t room) const {
    const std::uint32_t left_room = static_cast<std::uint32_t>(
        static_cast<std::uint64_t>(room) * left / (std::uint64_t{left} + right));
    const std::uint32_t at = task.first + left;
    if (left_room > 0) {
      const auto source = references_.begin() + at;
      std::copy_backward(source, source + right, source + right + left_room);
    }
    return {Task{task.first, left, left_room, task.depth + 1},
            Task{at + left_room, right, room - left_room, task.depth + 1}};
  }

  /// Halves the references by centre along the longest axis, then by id, so that recursion always
  /// ends.
  static std::uint32_t split_by_count(std::span<Reference> range, const Box3f& centres) {
    const Vec3f size = centres.hi - centres.lo;
    const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
    const auto middle = range.begin() + static_cast<std::ptrdiff_t>(range.size() / 2);
    std::nth_element(range.begin(), middle, range.end(),
                     [axis](const Reference& a, const Reference& b) {
                       const float ca = a.centre(axis), cb = b.centre(axis);
                       return ca < cb || (ca == cb && a.id < b.id);
                     });
    return static_cast<std::uint32_t>(range.size() / 2);
  }

  std::span<Reference> references_;
  const BinaryBvhInput& input_;
  double root_area_ = 0;
};

/// Splits large ranges sequentially, then builds the subtrees below them in parallel and appends
/// them in order, so that the result does not depend on the threads.
std::vector<BinaryNode> build_nodes(const Builder& builder, const Task& root,
                                    const ParallelFor& parallel_for) {
  std::vector<BinaryNode> nodes(1);
  std::vector<Task> tasks = {root};
  std::vector<std::uint32_t> roots;
  for (std::uint32_t i = 0; i < nodes.size(); ++i) {
    if (tasks[i].count <= kParallelRange) {
      roots.push_back(i);
    } else {
      builder.divide(nodes, tasks, i);
    }
  }
  std::vector<std::vector<BinaryNode>> subtrees(roots.size());
  parallel_for(static_cast<std::int64_t>(roots.size()), [&](std::int64_t i) {
    const auto r = static_cast<std::size_t>(i);
    subtrees[r] = builder.build(tasks[roots[r]]);
  });
  for (std::size_t r = 0; r < roots.size(); ++r) {
    // Element 0 of a subtree replaces its root, the others are appended.
    const auto offset = static_cast<std::uint32_t>(nodes.size()) - 1;
    for (BinaryNode& node : subtrees[r]) {
      if (node.leaf()) continue;
      node.left += offset;
      node.right += offset;
    }
    nodes[roots[r]] = subtrees[r][0];
    nodes.insert(nodes.end(), subtrees[r].begin() + 1, subtrees[r].end());
    std::vector<BinaryNode>().swap(subtrees[r]);
  }
  return nodes;
}

/// Collects the items of the leaves, each item once per leaf.
void gather_items(std::span<const Reference> references, BinaryBvh& bvh) {
  for (BinaryNode& node : bvh.nodes) {
    if (!node.leaf()) continue;
    const auto first = bvh.order.end() - bvh.order.begin();
    for (const Reference& r : references.subspan(node.first, node.count)) {
      const auto begin = bvh.order.begin() + first;
      if (std::find(begin, bvh.order.end(), r.id) == bvh.order.end()) bvh.order.push_back(r.id);
    }
    node.first = static_cast<std::uint32_t>(first);
    node.count = static_cast<std::uint32_t>(bvh.order.size()) - node.first;
  }
}

}  // namespace

ParallelFor sequential() {
  return [](std::int64_t count, const std::function<void(std::int64_t)>& body) {
    for (std::int64_t i = 0; i < count; ++i) body(i);
  };
}

BinaryBvh build_binary_bvh(const BinaryBvhInput& input, const ParallelFor& parallel_for) {
  BinaryBvh bvh;
  if (input.boxes.empty()) return bvh;
  const auto count = static_cast<std::uint32_t>(input.boxes.size());
  const auto room =
      input.cut == nullptr
          ? 0
          : static_cast<std::uint32_t>(static_cast<double>(count) * input.split_budget);
  std::vector<Reference> references(std::size_t{count} + room);
  for (std::uint32_t i = 0; i < count; ++i) references[i] = Reference(input.boxes[i], i);
  Builder builder(references, input);
  builder.set_root_area(bounds_of(std::span(references).first(count)).box.half_area());
  bvh.nodes = build_nodes(builder, {0, count, room, 0}, parallel_for);
  gather_items(references, bvh);
  return bvh;
}

}  // namespace tessera::render
