#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// 0 to 5: the axis that a normal is closest to, and its sign.
std::size_t facing(const Vec3f& normal);

/// A point of a surface.
struct SurfacePlace {
  Vec3f position, normal;  // world; unit
};

/// The surfaces near given places that face about the same way, as a grid of at most 32 cells along
/// each axis for each of six sides that a surface may face.
class VisibleRegion {
 public:
  static constexpr int kSide = 32;
  static constexpr std::size_t kCells = std::size_t{6} * kSide * kSide * kSide;

  /// No place: all of space.
  VisibleRegion() = default;
  /// The cells of the places and their neighbours.
  explicit VisibleRegion(std::span<const SurfacePlace> places);

  bool contains(const SurfacePlace& place) const { return is_all() || marks_[cell(place)] != 0; }

  bool is_all() const { return marks_.empty(); }
  /// Index of the cell of a place; kCells if it is outside the grid.
  std::size_t cell(const SurfacePlace& place) const;
  /// Cells that have a place themselves.
  std::span<const std::uint32_t> seen_cells() const { return seen_; }

 private:
  void mark_around(std::size_t cell);

  Vec3f low_;
  float per_metre_ = 0;              // cells
  std::vector<std::uint8_t> marks_;  // by cell, and of what is outside: 1 if it is in the region
  std::vector<std::uint32_t> seen_;
};

}  // namespace tessera::render
