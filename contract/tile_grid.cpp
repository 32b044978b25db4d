#include "contract/tile_grid.h"

#include <algorithm>

namespace tessera::contract {

namespace {

std::int32_t tiles_along(std::int32_t length_px, std::int32_t tile_px) {
  return (length_px + tile_px - 1) / tile_px;
}

}  // namespace

std::int32_t tile_count(const RenderSettings& settings) {
  const PixelRect window = settings.window();
  return tiles_along(window.width, settings.tile) * tiles_along(window.height, settings.tile);
}

TileGrid::TileGrid(const PixelRect& window, std::int32_t tile_px)
    : window_(window),
      tile_px_(tile_px),
      columns_(tiles_along(window.width, tile_px)),
      rows_(tiles_along(window.height, tile_px)),
      order_(hilbert_curve(columns_, rows_)),
      index_of_cell_(order_.size()) {
  for (std::size_t i = 0; i < order_.size(); ++i) {
    index_of_cell_[static_cast<std::size_t>(order_[i].y) * static_cast<std::size_t>(columns_) +
                   static_cast<std::size_t>(order_[i].x)] = static_cast<std::int32_t>(i);
  }
}

PixelRect TileGrid::rect(std::int32_t index) const {
  const GridPoint at = cell(index);
  const std::int32_t x = at.x * tile_px_, y = at.y * tile_px_;
  return {window_.x + x, window_.y + y, std::min(tile_px_, window_.width - x),
          std::min(tile_px_, window_.height - y)};
}

std::int32_t TileGrid::index_at(std::int32_t column, std::int32_t row) const {
  return index_of_cell_[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                        static_cast<std::size_t>(column)];
}

}  // namespace tessera::contract
