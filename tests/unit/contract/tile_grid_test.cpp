#include "contract/tile_grid.h"

#include <gtest/gtest.h>

namespace tessera::contract {
namespace {

TEST(TileGrid, TilesPartitionWindow) {
  for (const std::int32_t tile : {8, 16, 64, 256}) {
    for (std::int32_t width = 1; width <= 70; width += 3) {
      for (std::int32_t height = 1; height <= 70; height += 7) {
        const PixelRect window{5, 9, width, height};
        const TileGrid grid(window, tile);
        RenderSettings settings;
        settings.crop = window;
        settings.tile = tile;
        ASSERT_EQ(tile_count(settings), grid.tile_count());
        std::vector<int> covered(static_cast<std::size_t>(width * height));
        for (std::int32_t index = 0; index < grid.tile_count(); ++index) {
          const PixelRect rect = grid.rect(index);
          ASSERT_GE(rect.width, 1);
          ASSERT_LE(rect.width, tile);
          ASSERT_GE(rect.height, 1);
          ASSERT_LE(rect.height, tile);
          for (std::int32_t y = rect.y; y < rect.y + rect.height; ++y) {
            for (std::int32_t x = rect.x; x < rect.x + rect.width; ++x) {
              const std::int32_t at = (y - window.y) * width + (x - window.x);
              ASSERT_GE(at, 0);
              ++covered.at(static_cast<std::size_t>(at));
            }
          }
        }
        for (const int times : covered) ASSERT_EQ(times, 1);
      }
    }
  }
}

TEST(TileGrid, IndexAndCellAreInverse) {
  const TileGrid grid(PixelRect{0, 0, 1000, 333}, 16);
  EXPECT_EQ(grid.columns(), 63);
  EXPECT_EQ(grid.rows(), 21);
  for (std::int32_t index = 0; index < grid.tile_count(); ++index) {
    const GridPoint cell = grid.cell(index);
    ASSERT_EQ(grid.index_at(cell.x, cell.y), index);
    const PixelRect rect = grid.rect(index);
    ASSERT_EQ(rect.x, 16 * cell.x);
    ASSERT_EQ(rect.y, 16 * cell.y);
  }
}

TEST(TileGrid, IndicesFollowHilbertCurve) {
  const TileGrid grid(PixelRect{0, 0, 640, 480}, 32);
  const std::vector<GridPoint> curve = hilbert_curve(20, 15);
  ASSERT_EQ(static_cast<std::size_t>(grid.tile_count()), curve.size());
  for (std::int32_t index = 0; index < grid.tile_count(); ++index) {
    ASSERT_EQ(grid.cell(index), curve[static_cast<std::size_t>(index)]);
  }
}

TEST(TileGrid, CropOffsetsTiles) {
  RenderSettings settings;
  settings.width = 500;
  settings.height = 400;
  settings.crop = PixelRect{33, 77, 100, 10};
  settings.tile = 64;
  const TileGrid grid(settings);
  EXPECT_EQ(grid.tile_count(), 2);
  EXPECT_EQ(grid.rect(grid.index_at(0, 0)), (PixelRect{33, 77, 64, 10}));
  EXPECT_EQ(grid.rect(grid.index_at(1, 0)), (PixelRect{97, 77, 36, 10}));
}

}  // namespace
}  // namespace tessera::contract
