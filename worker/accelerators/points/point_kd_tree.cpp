// A kd-tree over points. The tree is the order of the points: a range is divided at its median
// along x, y or z in turn, so there is nothing to store for a node but its plane. The search
// descends to the side of the query first; the other side is visited if the cell there is near
// enough, whose distance grows by one axis per plane crossed.
//
// Sources: J. Bentley, "Multidimensional binary search trees used for associative searching", 1975;
// J. Friedman, J. Bentley, R. Finkel, "An algorithm for finding best matches in logarithmic
// expected time", 1977; S. Arya, D. Mount, "Algorithms for fast vector quantization", 1993 (the
// distance of cells).

#include <algorithm>
#include <numeric>

#include "worker/accelerators/points/nearest.h"

namespace tessera::render::accelerators {
namespace {

constexpr std::uint32_t kLeafSize = 4;

class PointKdTree final : public PointIndex {
 public:
  explicit PointKdTree(std::span<const Vec3f> points)
      : points_(points.begin(), points.end()), order_(points.size()), planes_(points.size()) {
    std::iota(order_.begin(), order_.end(), 0u);
    divide({0, static_cast<std::uint32_t>(order_.size()), 0});
  }

  std::vector<Neighbour> nearest(const Vec3f& query, std::size_t k,
                                 SearchStats& stats) const override {
    NearestList list(k);
    search({0, static_cast<std::uint32_t>(order_.size()), 0}, Vec3d{}, {query, list, stats});
    return std::move(list).sorted();
  }

 private:
  /// A node: the points order_[first, end).
  struct Range {
    std::uint32_t first, end;
    int axis;

    bool leaf() const { return end - first <= kLeafSize; }
    std::uint32_t middle() const { return first + (end - first) / 2; }
    Range below() const { return {first, middle(), (axis + 1) % 3}; }
    Range above() const { return {middle(), end, (axis + 1) % 3}; }
  };
  struct Search {
    const Vec3f& query;
    NearestList& list;
    SearchStats& stats;
  };

  void divide(const Range& range) {
    if (range.leaf()) return;
    std::nth_element(order_.begin() + range.first, order_.begin() + range.middle(),
                     order_.begin() + range.end, [&](std::uint32_t a, std::uint32_t b) {
                       return points_[a][range.axis] < points_[b][range.axis];
                     });
    planes_[range.middle()] = points_[order_[range.middle()]][range.axis];
    divide(range.below());
    divide(range.above());
  }

  /// `outside` is the vector from the nearest point of the node's cell to the query.
  void search(const Range& range, const Vec3d& outside, const Search& search_for) const {
    if (!search_for.list.may_add(squared_length(outside))) return;
    ++search_for.stats.nodes;
    if (range.leaf()) {
      for (std::uint32_t i = range.first; i < range.end; ++i) {
        ++search_for.stats.points;
        const std::uint32_t point = order_[i];
        search_for.list.add({squared_distance(points_[point], search_for.query), point});
      }
      return;
    }
    const double plane = planes_[range.middle()];
    const double beyond = static_cast<double>(search_for.query[range.axis]) - plane;
    Vec3d across = outside;
    across[range.axis] = beyond;
    search(beyond < 0 ? range.below() : range.above(), outside, search_for);
    search(beyond < 0 ? range.above() : range.below(), across, search_for);
  }

  std::vector<Vec3f> points_;
  std::vector<std::uint32_t> order_;
  std::vector<float> planes_;  // by Range::middle()
};

}  // namespace

std::unique_ptr<PointIndex> build_point_kd_tree(std::span<const Vec3f> points) {
  return std::make_unique<PointKdTree>(points);
}

}  // namespace tessera::render::accelerators
