// A BVH over points: boxes fit the points in them, unlike the cells of a kd-tree, but may overlap.
// The search visits the nearer box first. Source: N. Roussopoulos, S. Kelley, F. Vincent, "Nearest
// neighbor queries", 1995 (for R-trees).

#include <utility>

#include "worker/accel/binary_bvh/binary_bvh.h"
#include "worker/accelerators/points/nearest.h"

namespace tessera::render::accelerators {
namespace {

constexpr std::uint32_t kLeafSize = 4;

double squared_distance(const Box3f& box, const Vec3f& query) {
  Vec3d d;
  for (int k = 0; k < 3; ++k) {
    const double q = query[k];
    if (q < double{box.lo[k]}) d[k] = q - double{box.lo[k]};
    if (q > double{box.hi[k]}) d[k] = q - double{box.hi[k]};
  }
  return squared_length(d);
}

class PointBvh final : public PointIndex {
 public:
  explicit PointBvh(std::span<const Vec3f> points) : points_(points.begin(), points.end()) {
    std::vector<Box3f> boxes;
    for (const Vec3f& point : points) boxes.push_back({point, point});
    bvh_ = build_binary_bvh({boxes, kLeafSize}, sequential());
  }

  std::vector<Neighbour> nearest(const Vec3f& query, std::size_t k,
                                 SearchStats& stats) const override {
    NearestList list(k);
    if (!bvh_.nodes.empty()) search(bvh_.nodes[0], {query, list, stats});
    return std::move(list).sorted();
  }

 private:
  struct Search {
    const Vec3f& query;
    NearestList& list;
    SearchStats& stats;
  };

  void search(const BinaryNode& node, const Search& search_for) const {
    ++search_for.stats.nodes;
    if (node.leaf()) {
      for (std::uint32_t i = 0; i < node.count; ++i) {
        ++search_for.stats.points;
        const std::uint32_t point = bvh_.order[node.first + i];
        search_for.list.add(
            {accelerators::squared_distance(points_[point], search_for.query), point});
      }
      return;
    }
    const BinaryNode* near = &bvh_.nodes[node.left];
    const BinaryNode* far = &bvh_.nodes[node.right];
    double near_distance = squared_distance(near->box, search_for.query);
    double far_distance = squared_distance(far->box, search_for.query);
    if (far_distance < near_distance) {
      std::swap(near, far);
      std::swap(near_distance, far_distance);
    }
    if (search_for.list.may_add(near_distance)) search(*near, search_for);
    if (search_for.list.may_add(far_distance)) search(*far, search_for);
  }

  std::vector<Vec3f> points_;
  BinaryBvh bvh_;
};

}  // namespace

std::unique_ptr<PointIndex> build_point_bvh(std::span<const Vec3f> points) {
  return std::make_unique<PointBvh>(points);
}

}  // namespace tessera::render::accelerators
