#include "worker/accelerators/points/nearest.h"

#include <algorithm>

namespace tessera::render::accelerators {

void NearestList::add(const Neighbour& neighbour) {
  if (found_.size() == k_) {
    if (k_ == 0 || found_.front() <= neighbour) return;
    std::pop_heap(found_.begin(), found_.end());
    found_.pop_back();
  }
  found_.push_back(neighbour);
  std::push_heap(found_.begin(), found_.end());
}

std::vector<Neighbour> NearestList::sorted() && {
  std::sort_heap(found_.begin(), found_.end());
  return std::move(found_);
}

std::vector<Neighbour> nearest_by_brute_force(std::span<const Vec3f> points, const Vec3f& query,
                                              std::size_t k) {
  std::vector<Neighbour> all;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    all.push_back({squared_distance(points[i], query), i});
  }
  std::sort(all.begin(), all.end());
  all.resize(std::min(k, all.size()));
  return all;
}

}  // namespace tessera::render::accelerators
