// A BVH for the rays of one picture. The surface area heuristic (SAH) assumes rays that come from
// anywhere and pass through everything. Here the chance that a ray enters a child is counted over a
// sample of the picture's own rays, which end at their hits: geometry that no ray reaches costs
// nothing, wherever it lies. The SAH's chance counts like kPriorRays further rays, so it decides
// where few rays pass, and alone without a sample. All else is as in build_binary_bvh().
//
// Sources: J. Bittner, V. Havran, "RDH: ray distribution heuristics for construction of spatial
// data structures", 2009; M. Vinkler, V. Havran, J. Sochor, "Visibility driven BVH build up
// algorithm for ray tracing", 2012 (occlusion).

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "worker/accelerators/trees/trees.h"
#include "worker/accelerators/trees/two_wide_bvh.h"

namespace tessera::render::accelerators {
namespace {

constexpr int kBins = 32;
constexpr double kPriorRays = 8;
/// From this depth on shapes are halved by number, so that the recursion ends.
constexpr int kMaxDepth = 40;

/// A ray that ends at t = end.
struct SampleRay {
  ObjectRay line;
  float end;

  bool enters(const Box3f& box) const {
    float enter = 0;
    return !box.empty() && may_hit(line, box, end, enter);
  }
};

std::vector<SampleRay> prepare(std::span<const Ray> rays, const Box3f& all) {
  std::vector<SampleRay> out;
  for (const Ray& ray : rays) {
    SampleRay sample{{}, ray.t_max};
    if (make_object_ray(ray.origin, ray.direction, all, sample.line)) out.push_back(sample);
  }
  return out;
}

using Numbers = std::vector<std::uint32_t>;

/// Shapes with their centres in one of kBins slabs of equal width.
struct Bins {
  float low = 0, width = 0;
  std::array<Box3f, kBins> boxes;
  std::array<std::uint32_t, kBins> counts{};

  std::size_t of(float centre) const {
    const float b = (centre - low) / width;
    return b > 0 ? (b < kBins - 1 ? static_cast<std::size_t>(b) : kBins - 1) : 0;
  }
};

/// The shapes on one side of plane i, which lies before bin i: their box, their number, and the
/// number of rays that enter the box.
struct Side {
  std::array<Box3f, kBins + 1> boxes;
  std::array<std::uint32_t, kBins + 1> counts{};
  std::array<std::uint32_t, kBins + 1> rays{};
};

struct Cut {
  int axis = -1;  // -1: none
  std::size_t plane = 0;
  double cost = 0;
  Bins bins;
};

class Builder {
 public:
  Builder(const ShapeBounds& shapes, std::vector<SampleRay> rays)
      : shapes_(shapes), rays_(std::move(rays)) {}

  BinaryBvh build() {
    Numbers rays = all_shapes(static_cast<std::uint32_t>(rays_.size()));
    bvh_.nodes.emplace_back();
    divide(0, all_shapes(shapes_.size()), std::move(rays), 0);
    return std::move(bvh_);
  }

 private:
  /// Builds the tree below a node over `shapes`; `rays` are those that enter its parent.
  void divide(std::uint32_t index, Numbers shapes, Numbers rays, int depth) {
    Box3f box;
    for (const std::uint32_t shape : shapes) box.extend(shapes_.boxes[shape]);
    bvh_.nodes[index].box = box;
    rays.erase(std::remove_if(rays.begin(), rays.end(),
                              [&](std::uint32_t ray) { return !rays_[ray].enters(box); }),
               rays.end());
    const Cut cut = depth < kMaxDepth ? choose(shapes, rays, box) : Cut{};
    if (shapes.size() <= kTwoWideLeafSize && !(cut.axis >= 0 && cut.cost < 0.6)) {
      bvh_.nodes[index].first = static_cast<std::uint32_t>(bvh_.order.size());
      bvh_.nodes[index].count = static_cast<std::uint32_t>(shapes.size());
      bvh_.order.insert(bvh_.order.end(), shapes.begin(), shapes.end());
      return;
    }
    auto middle = shapes.begin() + static_cast<std::ptrdiff_t>(shapes.size() / 2);
    if (cut.axis >= 0) {
      middle = std::stable_partition(shapes.begin(), shapes.end(), [&](std::uint32_t shape) {
        return cut.bins.of(centre(shape, cut.axis)) < cut.plane;
      });
    }
    Numbers right(middle, shapes.end());
    shapes.erase(middle, shapes.end());
    const auto left = static_cast<std::uint32_t>(bvh_.nodes.size());
    bvh_.nodes[index].left = left;
    bvh_.nodes[index].right = left + 1;
    bvh_.nodes.resize(bvh_.nodes.size() + 2);
    divide(left, std::move(shapes), rays, depth + 1);
    divide(left + 1, std::move(right), std::move(rays), depth + 1);
  }

  float centre(std::uint32_t shape, int axis) const {
    const Box3f& box = shapes_.boxes[shape];
    return box.lo[axis] / 2 + box.hi[axis] / 2;
  }

  /// Returns the cheapest cut; its cost is the expected number of leaf tests of a ray that enters
  /// the node.
  Cut choose(const Numbers& shapes, const Numbers& rays, const Box3f& box) const {
    Cut best;
    for (int axis = 0; axis < 3; ++axis) {
      const Bins bins = fill(shapes, axis);
      if (!(bins.width > 0)) continue;
      Side below, above;
      for (std::size_t i = 1; i < kBins; ++i) extend(below, i, i - 1, bins, i - 1);
      for (std::size_t i = kBins - 1; i > 0; --i) extend(above, i, i + 1, bins, i);
      count_rays(rays, below, above);
      for (std::size_t i = 1; i < kBins; ++i) {
        if (below.counts[i] == 0 || above.counts[i] == 0) continue;
        const double cost =
            expected(below, i, rays.size(), box) + expected(above, i, rays.size(), box);
        if (best.axis < 0 || cost < best.cost) best = {axis, i, cost, bins};
      }
    }
    return best;
  }

  Bins fill(const Numbers& shapes, int axis) const {
    Bins bins;
    float low = std::numeric_limits<float>::infinity(), high = -low;
    for (const std::uint32_t shape : shapes) {
      low = std::min(low, centre(shape, axis));
      high = std::max(high, centre(shape, axis));
    }
    bins.low = low;
    bins.width = (high - low) / kBins;
    if (!(bins.width > 0)) return bins;
    for (const std::uint32_t shape : shapes) {
      const std::size_t bin = bins.of(centre(shape, axis));
      bins.boxes[bin].extend(shapes_.boxes[shape]);
      ++bins.counts[bin];
    }
    return bins;
  }

  /// Makes the side of plane `to` from that of plane `from` and one more bin.
  static void extend(Side& side, std::size_t to, std::size_t from, const Bins& bins,
                     std::size_t bin) {
    side.boxes[to] = side.boxes[from];
    side.boxes[to].extend(bins.boxes[bin]);
    side.counts[to] = side.counts[from] + bins.counts[bin];
  }

  /// Boxes below a plane grow with the plane's index and those above it shrink, so each ray enters
  /// the ones after, or before, an index that bisection finds.
  void count_rays(const Numbers& rays, Side& below, Side& above) const {
    std::array<std::uint32_t, kBins + 1> first_below{}, first_not_above{};
    for (const std::uint32_t ray : rays) {
      ++first_below[bisect([&](std::size_t i) { return rays_[ray].enters(below.boxes[i]); })];
      ++first_not_above[bisect([&](std::size_t i) { return !rays_[ray].enters(above.boxes[i]); })];
    }
    std::uint32_t entered = 0, left = static_cast<std::uint32_t>(rays.size());
    for (std::size_t i = 1; i < kBins; ++i) {
      below.rays[i] = entered += first_below[i];
      above.rays[i] = left -= first_not_above[i];
    }
  }

  /// Returns the first index in [1, kBins) for which `test` is true, or kBins. Requires that it is
  /// true for all later ones.
  template <typename Test>
  static std::size_t bisect(const Test& test) {
    std::size_t first = 1, end = kBins;
    while (first < end) {
      const std::size_t middle = (first + end) / 2;
      if (test(middle)) {
        end = middle;
      } else {
        first = middle + 1;
      }
    }
    return first;
  }

  /// Returns the leaf tests of a child times the chance that a ray in the node enters the child.
  static double expected(const Side& side, std::size_t plane, std::size_t rays, const Box3f& box) {
    const double area = box.half_area();
    const double by_area = area > 0 ? side.boxes[plane].half_area() / area : 1;
    const double chance =
        (side.rays[plane] + kPriorRays * by_area) / (static_cast<double>(rays) + kPriorRays);
    const std::uint32_t tests = (side.counts[plane] + kTwoWideLeafSize - 1) / kTwoWideLeafSize;
    return chance * tests;
  }

  const ShapeBounds& shapes_;
  const std::vector<SampleRay> rays_;
  BinaryBvh bvh_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_rdh_bvh(const ShapeBounds& shapes) {
  return make_two_wide_bvh(Builder(shapes, prepare(shapes.rays, shapes.all())).build());
}

}  // namespace tessera::render::accelerators
