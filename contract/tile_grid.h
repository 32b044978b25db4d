#pragma once

#include <cstdint>
#include <vector>

#include "contract/hilbert.h"
#include "contract/render_settings.h"

namespace tessera::contract {

/// Returns the number of tiles of a frame without building the grid. At most 2^26.
std::int32_t tile_count(const RenderSettings& settings);

/// The tiles of a frame's window, numbered along a Hilbert curve over the tile grid.
///
/// Tile corners are at multiples of the tile size from the window's corner; border tiles are
/// smaller.
class TileGrid {
 public:
  /// Requires a window of positive size and tile_px >= 1.
  TileGrid(const PixelRect& window, std::int32_t tile_px);
  explicit TileGrid(const RenderSettings& settings) : TileGrid(settings.window(), settings.tile) {}

  std::int32_t tile_count() const { return static_cast<std::int32_t>(order_.size()); }
  std::int32_t columns() const { return columns_; }
  std::int32_t rows() const { return rows_; }
  const PixelRect& window() const { return window_; }

  /// Pixels of tile `index`, in frame coordinates. Requires 0 <= index < tile_count().
  PixelRect rect(std::int32_t index) const;
  /// Column and row of tile `index` in the grid.
  GridPoint cell(std::int32_t index) const { return order_[static_cast<std::size_t>(index)]; }
  /// Index of the tile in the given grid cell.
  std::int32_t index_at(std::int32_t column, std::int32_t row) const;

 private:
  PixelRect window_;
  std::int32_t tile_px_, columns_, rows_;
  std::vector<GridPoint> order_;
  std::vector<std::int32_t> index_of_cell_;  // row-major
};

}  // namespace tessera::contract
