#include "worker/accelerators/grids/grid.h"

#include <algorithm>
#include <utility>

namespace tessera::render::accelerators {
namespace {

constexpr double kCellsPerShape = 2;
constexpr int kMaxCellsPerSide = 512;
/// The pad as a fraction of a cell's width.
constexpr double kPad = 1.0 / 16;

/// Returns the width of cubes such that `cells` of them fill a box of this size; a side shorter
/// than a cube counts as one cube. Uses bisection, which needs no special case for flat boxes.
double cell_width(const Vec3d& size, double cells) {
  double small = max_component(size) / kMaxCellsPerSide, large = max_component(size);
  if (!(small > 0)) return 1;
  for (int i = 0; i < 40; ++i) {
    const double width = 0.5 * (small + large);
    double filled = 1;
    for (int k = 0; k < 3; ++k) filled *= std::max(1.0, size[k] / width);
    (filled > cells ? small : large) = width;
  }
  return large;
}

}  // namespace

Grid::Grid(const Box3d& region, std::size_t shape_count) {
  const double width =
      cell_width(region.hi - region.lo, kCellsPerShape * static_cast<double>(shape_count));
  pad_ = kPad * width;
  for (int k = 0; k < 3; ++k) {
    const double size = region.hi[k] - region.lo[k] + 2 * pad_;
    count_[static_cast<std::size_t>(k)] =
        std::clamp(static_cast<int>(size / width), 1, kMaxCellsPerSide);
    lo_[k] = region.lo[k] - pad_;
    width_[k] = size / count(k);
  }
}

Box3d Grid::cell_box(const std::array<int, 3>& cell) const {
  Box3d box;
  for (int k = 0; k < 3; ++k) {
    box.lo[k] = plane(k, cell[static_cast<std::size_t>(k)]);
    box.hi[k] = plane(k, cell[static_cast<std::size_t>(k)] + 1);
  }
  return box;
}

Segment Grid::inside(const ShapeRay& ray, float limit) const {
  Segment part{0, static_cast<double>(limit)};
  for (int k = 0; k < 3; ++k) {
    part = clip(ray, part, k, plane(k, 0), true);
    part = clip(ray, part, k, plane(k, count(k)), false);
  }
  return part;
}

bool GridTraversal::skip(int radius) {
  // Finds the first boundary of the cube of empty cells that the ray reaches.
  int axis = -1;
  double out = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k) {
    const int step = step_[at(k)];
    if (step == 0) continue;
    const int beyond = cell_[at(k)] + (step > 0 ? radius : 1 - radius);
    const double t = (grid_.plane(k, beyond) - ray_.origin[k]) / ray_.box_direction[k];
    if (!(t < out)) continue;
    out = t;
    axis = k;
  }
  const std::array<int, 3> before = cell_;
  for (int k = 0; k < 3; ++k) {
    if (k == axis || step_[at(k)] == 0) continue;
    const int cell = grid_.cell_of(k, ray_.origin[k] + out * ray_.box_direction[k]);
    set_cell(k, std::clamp(cell, before[at(k)] - (radius - 1), before[at(k)] + (radius - 1)));
  }
  return axis >= 0 && step_cells(axis, radius);
}

CellLists::CellLists(const Grid& grid, std::span<const Box3f> boxes,
                     std::span<const std::uint32_t> shapes)
    : starts_(grid.cell_count() + 1) {
  for (const std::uint32_t shape : shapes) {
    grid.for_each_cell(boxes[shape], [&](const auto& cell) { ++starts_[grid.index(cell) + 1]; });
  }
  for (std::size_t i = 1; i < starts_.size(); ++i) starts_[i] += starts_[i - 1];
  shapes_.resize(starts_.back());
  std::vector<std::uint32_t> next(starts_.begin(), starts_.end() - 1);
  for (const std::uint32_t shape : shapes) {
    grid.for_each_cell(boxes[shape],
                       [&](const auto& cell) { shapes_[next[grid.index(cell)]++] = shape; });
  }
}

UniformGrid::UniformGrid(std::span<const Box3f> boxes, std::vector<std::uint32_t> shapes)
    : shapes_(std::move(shapes)),
      grid_(box_of(boxes, shapes_), shapes_.size()),
      cells_(grid_, boxes, shapes_) {}

Box3d box_of(std::span<const Box3f> boxes, std::span<const std::uint32_t> shapes) {
  Box3f box;
  for (const std::uint32_t shape : shapes) box.extend(boxes[shape]);
  return {Vec3d(box.lo), Vec3d(box.hi)};
}

}  // namespace tessera::render::accelerators
