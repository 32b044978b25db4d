#include "contract/hilbert.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <vector>

namespace tessera::contract {
namespace {

/// Result of a walk over a curve.
struct Walk {
  bool every_cell_once = true;
  int diagonal_steps = 0, long_steps = 0;
};

Walk walk(std::int32_t width, std::int32_t height) {
  const std::vector<GridPoint> curve = hilbert_curve(width, height);
  Walk result;
  const auto cells = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  result.every_cell_once = curve.size() == cells;
  std::vector<bool> seen(cells);
  for (std::size_t i = 0; i < curve.size(); ++i) {
    const auto [x, y] = curve[i];
    if (x < 0 || x >= width || y < 0 || y >= height) {
      result.every_cell_once = false;
      continue;
    }
    const auto cell =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    if (seen[cell]) result.every_cell_once = false;
    seen[cell] = true;
    if (i == 0) continue;
    const int dx = std::abs(x - curve[i - 1].x), dy = std::abs(y - curve[i - 1].y);
    if (dx > 1 || dy > 1) {
      ++result.long_steps;
    } else if (dx + dy == 2) {
      ++result.diagonal_steps;
    }
  }
  return result;
}

TEST(HilbertCurve, VisitsEveryCellOnceUpTo32x32) {
  for (std::int32_t width = 1; width <= 32; ++width) {
    for (std::int32_t height = 1; height <= 32; ++height) {
      const Walk found = walk(width, height);
      ASSERT_TRUE(found.every_cell_once) << width << "x" << height;
      ASSERT_EQ(found.long_steps, 0) << width << "x" << height;
      ASSERT_LE(found.diagonal_steps, 1) << width << "x" << height;
    }
  }
}

TEST(HilbertCurve, HasNoDiagonalStepIfLongerSideIsEven) {
  for (std::int32_t width = 1; width <= 32; ++width) {
    for (std::int32_t height = 1; height <= 32; ++height) {
      if (std::max(width, height) % 2 != 0) continue;
      ASSERT_EQ(walk(width, height).diagonal_steps, 0) << width << "x" << height;
    }
  }
}

TEST(HilbertCurve, DifficultGridsAreCovered) {
  // Hard case 73.
  const std::pair<std::int32_t, std::int32_t> grids[] = {
      {1, 4096}, {4096, 1}, {7, 3}, {15, 12}, {10000, 10}, {1001, 999}, {2, 100000}, {100000, 2}};
  for (const auto& [width, height] : grids) {
    const Walk found = walk(width, height);
    EXPECT_TRUE(found.every_cell_once) << width << "x" << height;
    EXPECT_EQ(found.long_steps, 0) << width << "x" << height;
    EXPECT_LE(found.diagonal_steps, 1) << width << "x" << height;
  }
}

TEST(HilbertCurve, StartsAtTopLeftCell) {
  for (std::int32_t width = 1; width <= 32; ++width) {
    for (std::int32_t height = 1; height <= 32; ++height) {
      ASSERT_EQ(hilbert_curve(width, height).front(), (GridPoint{0, 0}));
    }
  }
}

TEST(HilbertCurve, StaysLocalOnPowersOfTwo) {
  // Defining property of a Hilbert curve: n consecutive cells stay in a box of area O(n). Any run
  // of n = 64 cells of the true curve spans at most 4 aligned 8x8 blocks, so at most 31 cells
  // either way.
  const std::vector<GridPoint> curve = hilbert_curve(64, 64);
  for (std::size_t i = 0; i + 64 <= curve.size(); ++i) {
    GridPoint low = curve[i], high = curve[i];
    for (std::size_t k = i; k < i + 64; ++k) {
      low = {std::min(low.x, curve[k].x), std::min(low.y, curve[k].y)};
      high = {std::max(high.x, curve[k].x), std::max(high.y, curve[k].y)};
    }
    ASSERT_LT(high.x - low.x, 32) << "at " << i;
    ASSERT_LT(high.y - low.y, 32) << "at " << i;
  }
}

}  // namespace
}  // namespace tessera::contract
