#include "worker/guide/visible_region.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "worker/geometry/object_ray.h"

namespace tessera::render {

std::size_t facing(const Vec3f& normal) {
  const int axis = largest_axis(absolute(normal));
  return 2 * static_cast<std::size_t>(axis) + (normal[axis] < 0 ? 1 : 0);
}

VisibleRegion::VisibleRegion(std::span<const SurfacePlace> places) {
  Box3f box;
  for (const SurfacePlace& place : places) box.extend(place.position);
  if (box.empty()) return;
  const float side = max_component(box.hi - box.lo);
  if (!(side > 0) || !std::isfinite(side)) return;
  // One cell of margin on each side.
  per_metre_ = (kSide - 2) / (side * (1 + 0x1p-10f));
  const float margin = 1 / per_metre_;
  low_ = box.lo - Vec3f{margin, margin, margin};
  std::vector<std::uint8_t> seen(kCells);
  for (const SurfacePlace& place : places) seen[cell(place)] = 1;
  marks_.assign(kCells + 1, 0);
  for (std::size_t i = 0; i < kCells; ++i) {
    if (seen[i] == 0) continue;
    seen_.push_back(static_cast<std::uint32_t>(i));
    mark_around(i);
  }
}

/// Marks a cell and its neighbours. Rounding may move a place into the margin, so that some would
/// be outside the grid.
void VisibleRegion::mark_around(std::size_t cell) {
  const std::size_t x = cell % kSide, y = cell / kSide % kSide, z = cell / kSide / kSide % kSide;
  const std::size_t side = cell - (z * kSide + y) * kSide - x;
  const auto last = [](std::size_t at) { return std::min<std::size_t>(at + 1, kSide - 1); };
  const auto first = [](std::size_t at) { return at - std::min<std::size_t>(at, 1); };
  for (std::size_t c = first(z); c <= last(z); ++c) {
    for (std::size_t b = first(y); b <= last(y); ++b) {
      for (std::size_t a = first(x); a <= last(x); ++a)
        marks_[side + (c * kSide + b) * kSide + a] = 1;
    }
  }
}

std::size_t VisibleRegion::cell(const SurfacePlace& place) const {
  std::array<std::size_t, 3> at{};
  for (int axis = 0; axis < 3; ++axis) {
    const float x = (place.position[axis] - low_[axis]) * per_metre_;
    if (!(x >= 0) || !(x < kSide)) return kCells;
    at[static_cast<std::size_t>(axis)] = static_cast<std::size_t>(x);
  }
  return ((facing(place.normal) * kSide + at[2]) * kSide + at[1]) * kSide + at[0];
}

}  // namespace tessera::render
