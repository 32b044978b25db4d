#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::accelerators {

/// A box divided into equal, almost cubic cells. The number of cells is proportional to the number
/// of shapes.
///
/// A shape is registered in every cell that its box, widened by `pad`, overlaps. This includes the
/// cell in which the ray is at a hit, even on cell boundaries: the hit is near the box, and the
/// rounding of the ray's position in double is much smaller than the pad. Source of the numbers of
/// cells, which are proportional to the sides of the box: K. Klimaszewski, T. Sederberg, "Faster
/// ray tracing using adaptive grids", 1997.
class Grid {
 public:
  /// Divides `region`, widened by the pad.
  Grid(const Box3d& region, std::size_t shape_count);

  /// Returns whether the pad covers the error of this ray's hits. It does not if the origin is
  /// thousands of cells away; all shapes must then be visited.
  bool covers(const ShapeRay& ray) const { return 2 * ray.hit_tolerance <= pad_; }

  std::size_t cell_count() const {
    return static_cast<std::size_t>(count_[0]) * static_cast<std::size_t>(count_[1]) *
           static_cast<std::size_t>(count_[2]);
  }
  int count(int axis) const { return count_[static_cast<std::size_t>(axis)]; }
  double pad() const { return pad_; }
  double plane(int axis, int i) const { return lo_[axis] + width_[axis] * i; }
  std::size_t index(const std::array<int, 3>& cell) const {
    return (static_cast<std::size_t>(cell[2]) * static_cast<std::size_t>(count_[1]) +
            static_cast<std::size_t>(cell[1])) *
               static_cast<std::size_t>(count_[0]) +
           static_cast<std::size_t>(cell[0]);
  }
  Box3d cell_box(const std::array<int, 3>& cell) const;
  /// Returns the cell of a coordinate along an axis, clamped to the grid.
  int cell_of(int axis, double x) const {
    const double i = (x - lo_[axis]) / width_[axis];
    const int last = count(axis) - 1;
    return i > 0 ? (i < last ? static_cast<int>(i) : last) : 0;
  }
  /// Calls visit(cell) for each cell that the widened box overlaps.
  template <typename Visit>
  void for_each_cell(const Box3f& box, Visit&& visit) const {
    std::array<int, 3> from{}, to{}, cell{};
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      from[i] = cell_of(k, static_cast<double>(box.lo[k]) - pad_);
      to[i] = cell_of(k, static_cast<double>(box.hi[k]) + pad_);
    }
    for (cell[2] = from[2]; cell[2] <= to[2]; ++cell[2]) {
      for (cell[1] = from[1]; cell[1] <= to[1]; ++cell[1]) {
        for (cell[0] = from[0]; cell[0] <= to[0]; ++cell[0]) visit(cell);
      }
    }
  }
  /// Returns the part of the ray in the grid.
  Segment inside(const ShapeRay& ray, float limit) const;

 private:
  Vec3d lo_, width_;
  std::array<int, 3> count_ = {1, 1, 1};
  double pad_ = 0;
};

/// Steps from cell to cell along a ray: a 3D-DDA that computes distances from planes instead of
/// accumulating them.
/// Source: J. Amanatides, A. Woo, "A fast voxel traversal algorithm for ray tracing", 1987.
class GridTraversal {
 public:
  /// Starts at the cell of the ray at `first`, which must be in the grid.
  GridTraversal(const Grid& grid, const ShapeRay& ray, double first) : grid_(grid), ray_(ray) {
    for (int k = 0; k < 3; ++k) {
      const double d = ray.box_direction[k];
      step_[at(k)] = d > 0 ? 1 : d < 0 ? -1 : 0;
      set_cell(k, grid.cell_of(k, ray.origin[k] + first * d));
    }
  }

  const std::array<int, 3>& cell() const { return cell_; }
  /// Returns the t at which the ray leaves the cell.
  double exit() const { return exit_[at(axis_of_exit())]; }
  /// Moves to the next cell; returns false outside the grid.
  bool next() { return step_cells(axis_of_exit(), 1); }
  /// Skips `radius` - 1 empty cells in every direction; returns false outside the grid.
  bool skip(int radius);

 private:
  static std::size_t at(int k) { return static_cast<std::size_t>(k); }

  void set_cell(int k, int cell) {
    cell_[at(k)] = cell;
    const int step = step_[at(k)];
    exit_[at(k)] = step == 0 ? std::numeric_limits<double>::infinity()
                             : (grid_.plane(k, cell + (step > 0 ? 1 : 0)) - ray_.origin[k]) /
                                   ray_.box_direction[k];
  }
  bool step_cells(int k, int cells) {
    const int cell = cell_[at(k)] + cells * step_[at(k)];
    if (step_[at(k)] == 0 || cell < 0 || cell >= grid_.count(k)) return false;
    set_cell(k, cell);
    return true;
  }
  int axis_of_exit() const {
    const int x_or_y = exit_[0] <= exit_[1] ? 0 : 1;
    return exit_[at(x_or_y)] <= exit_[2] ? x_or_y : 2;
  }

  const Grid& grid_;
  const ShapeRay& ray_;
  std::array<int, 3> cell_{}, step_{};
  std::array<double, 3> exit_{};
};

/// Calls `visit(cell)` for each cell along the ray up to the limit, which is read at every step,
/// until it returns true; returns whether it did.
template <typename Visit>
bool traverse_cells(const Grid& grid, const ShapeRay& ray, const float& limit,
                    TraversalStats& stats, const Visit& visit) {
  const Segment part = grid.inside(ray, limit);
  if (part.empty()) return false;
  GridTraversal traversal(grid, ray, part.first);
  do {
    ++stats.nodes;
    if (visit(grid.index(traversal.cell()))) return true;
  } while (!(static_cast<double>(limit) < traversal.exit()) && traversal.next());
  return false;
}

/// The shapes of each cell of a grid.
class CellLists {
 public:
  CellLists() = default;
  CellLists(const Grid& grid, std::span<const Box3f> boxes, std::span<const std::uint32_t> shapes);

  std::span<const std::uint32_t> shapes_in(std::size_t cell) const {
    return std::span(shapes_).subspan(starts_[cell], starts_[cell + 1] - starts_[cell]);
  }
  std::size_t memory_bytes() const {
    return (starts_.capacity() + shapes_.capacity()) * sizeof(std::uint32_t);
  }

 private:
  std::vector<std::uint32_t> starts_, shapes_;
};

/// A grid with the shapes of its cells.
class UniformGrid {
 public:
  /// Builds a grid of the `shapes`, which are indices of `boxes`.
  UniformGrid(std::span<const Box3f> boxes, std::vector<std::uint32_t> shapes);

  const Grid& grid() const { return grid_; }
  const CellLists& cells() const { return cells_; }
  std::span<const std::uint32_t> shapes() const { return shapes_; }
  /// `mailbox` is a Mailbox or RayMailboxes.
  template <typename AnyMailbox>
  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                AnyMailbox& mailbox, TraversalStats& stats) const {
    if (!grid_.covers(ray)) return visit_all(shapes_, visit, mailbox);
    return traverse_cells(grid_, ray, limit, stats, [&](std::size_t cell) {
      return visit_all(cells_.shapes_in(cell), visit, mailbox);
    });
  }
  std::size_t memory_bytes() const {
    return cells_.memory_bytes() + shapes_.capacity() * sizeof(std::uint32_t);
  }

 private:
  std::vector<std::uint32_t> shapes_;
  Grid grid_;
  CellLists cells_;
};

/// Returns the box around the `shapes`, which are indices of `boxes`.
Box3d box_of(std::span<const Box3f> boxes, std::span<const std::uint32_t> shapes);

}  // namespace tessera::render::accelerators
