#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "worker/math/vector.h"

namespace tessera::render::accelerators {

/// A point found near another one. Ordered by distance, then by index.
struct Neighbour {
  double distance_squared = 0;
  std::uint32_t point = 0;  // index
  auto operator<=>(const Neighbour&) const = default;
};

/// Cost of searches.
struct SearchStats {
  std::int64_t nodes = 0, points = 0;  // visited
};

/// Returns the squared length of a difference of points. Each operation is monotonic, also after
/// rounding: a difference that is nowhere larger is not longer, so that the distance of a box or a
/// plane computed in this way is never above that of a point behind it.
inline double squared_length(const Vec3d& d) {
  return d.x * d.x + d.y * d.y + d.z * d.z;
}

inline double squared_distance(const Vec3f& a, const Vec3f& b) {
  return squared_length(Vec3d(a) - Vec3d(b));
}

/// The k nearest neighbours found so far.
class NearestList {
 public:
  explicit NearestList(std::size_t k) : k_(k) {}
  /// Returns whether a point at this distance can be among the k nearest. True for a tie with the
  /// farthest, which the index decides.
  bool may_add(double distance_squared) const {
    return found_.size() < k_ || (k_ > 0 && distance_squared <= found_.front().distance_squared);
  }
  void add(const Neighbour& neighbour);
  /// Returns the neighbours in order.
  std::vector<Neighbour> sorted() &&;

 private:
  std::size_t k_;
  std::vector<Neighbour> found_;  // a heap with the farthest first
};

/// Finds the points nearest to a place. Immutable and thread-safe.
class PointIndex {
 public:
  virtual ~PointIndex() = default;
  /// Returns the k nearest points, or all if there are fewer, in order. Adds the cost to `stats`.
  /// Requires a finite query. Equal to nearest_by_brute_force() bit for bit.
  virtual std::vector<Neighbour> nearest(const Vec3f& query, std::size_t k,
                                         SearchStats& stats) const = 0;
};

/// Computes the distance of every point.
std::vector<Neighbour> nearest_by_brute_force(std::span<const Vec3f> points, const Vec3f& query,
                                              std::size_t k);

// Builders of trees, which copy the points. Points are finite, fewer than 2^31, and may coincide.

/// Divides space: median planes, with the axes in turn.
std::unique_ptr<PointIndex> build_point_kd_tree(std::span<const Vec3f> points);
/// Divides objects: a hierarchy of boxes around points, by build_binary_bvh().
std::unique_ptr<PointIndex> build_point_bvh(std::span<const Vec3f> points);

}  // namespace tessera::render::accelerators
