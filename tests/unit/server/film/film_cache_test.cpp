#include "server/film/film_cache.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <random>
#include <thread>

#include "tests/unit/server/film/made_blocks.h"

namespace tessera::server {
namespace {

using contract::FilmBlock;

constexpr std::int64_t kPlenty = std::int64_t{1} << 30;
const FrameKey frame_key{"job", 0};

/// A frame of 3 x 2 tiles (the last column and row are smaller) in three passes.
class FilmCacheTest : public ::testing::Test {
 protected:
  FilmCacheTest() {
    settings_.width = 70;
    settings_.height = 50;
    settings_.tile = 32;
    settings_.aovs = contract::kAovAlbedo | contract::kAovDepth;
    settings_.spp = 100;
    passes_ = contract::fixed_schedule(settings_.spp);
    grid_ = std::make_unique<contract::TileGrid>(settings_);
  }

  FilmBlock block(std::int32_t tile, std::int32_t pass) const {
    return made_block(grid_->rect(tile), settings_.aovs, pass,
                      passes_[static_cast<std::size_t>(pass)]);
  }
  void open(FilmCache& cache) {
    cache.open_frame(frame_key, settings_, passes_, [this](std::int32_t tile, std::int32_t pass) {
      ++reads_;
      return absl::StatusOr<FilmBlock>(block(tile, pass));
    });
  }
  std::vector<std::pair<std::int32_t, std::int32_t>> all_units() const {
    std::vector<std::pair<std::int32_t, std::int32_t>> units;
    for (std::size_t pass = 0; pass < passes_.size(); ++pass) {
      for (std::int32_t tile = 0; tile < grid_->tile_count(); ++tile) {
        units.emplace_back(tile, static_cast<std::int32_t>(pass));
      }
    }
    return units;
  }
  /// Every bit that can be told of a tile's pixels.
  static std::vector<float> pixels_of(const TileSum& tile) {
    std::vector<float> values;
    for (std::int64_t pixel = 0; pixel < tile.pixel_count(); ++pixel) {
      float rgba[4], xyz[3];
      tile.rgba(pixel, rgba);
      values.insert(values.end(), rgba, rgba + 4);
      tile.standard_error(pixel, xyz);
      values.insert(values.end(), xyz, xyz + 3);
      tile.albedo(pixel, xyz);
      values.insert(values.end(), xyz, xyz + 3);
    }
    values.insert(values.end(), tile.depth().begin(), tile.depth().end());
    return values;
  }
  std::vector<float> all_pixels(FilmCache& cache, bool take = true) {
    std::vector<float> values;
    for (std::int32_t tile = 0; tile < grid_->tile_count(); ++tile) {
      const auto sum = take ? cache.take_tile(frame_key, tile) : cache.tile(frame_key, tile);
      EXPECT_TRUE(sum.ok()) << sum.status();
      EXPECT_EQ(sum->pass_count(), static_cast<std::int32_t>(passes_.size()));
      const std::vector<float> more = pixels_of(*sum);
      values.insert(values.end(), more.begin(), more.end());
    }
    return values;
  }

  contract::RenderSettings settings_;
  std::vector<contract::Pass> passes_;
  std::unique_ptr<contract::TileGrid> grid_;
  std::atomic<int> reads_ = 0;
};

TEST_F(FilmCacheTest, SameBitsWhateverTheArrivalOrderDuplicatesOrMemory) {
  // Hard case 69.
  std::vector<float> expected;
  std::vector<double> errors;
  std::mt19937 rng(69);
  for (int trial = 0; trial < 12; ++trial) {
    FilmCache cache(trial % 3 == 2 ? 1 : kPlenty);  // 1 byte: every tile is rebuilt each time
    open(cache);
    auto units = all_units();
    if (trial > 0) std::shuffle(units.begin(), units.end(), rng);
    if (trial % 2 == 1) {  // some come twice
      for (int copies = 0; copies < 5; ++copies) units.push_back(units[rng() % units.size()]);
    }
    for (const auto& [tile, pass] : units) {
      ASSERT_TRUE(cache.add(frame_key, tile, pass, block(tile, pass)).ok());
    }
    std::vector<double> figures = {*cache.mean_luminance(frame_key)};
    const std::vector<float> pixels = all_pixels(cache, trial % 4 < 2);
    for (std::int32_t pass = 0; pass < 3; ++pass) {
      const ErrorEstimate estimate = cache.estimate_after_pass(frame_key, pass);
      EXPECT_EQ(estimate.pixels, 70 * 50) << "pass " << pass << " of trial " << trial;
      figures.insert(figures.end(), {estimate.rmse, estimate.relmse, estimate.error,
                                     estimate.error_upper95, estimate.n_eff});
    }
    if (trial == 0) {
      expected = pixels;
      errors = figures;
    }
    EXPECT_EQ(pixels, expected) << "trial " << trial;
    EXPECT_EQ(figures, errors) << "trial " << trial;
  }
}

TEST_F(FilmCacheTest, RestartFromTheJournalGivesTheSameBits) {
  FilmCache before(kPlenty), after(kPlenty);
  open(before);
  for (const auto& [tile, pass] : all_units()) {
    ASSERT_TRUE(before.add(frame_key, tile, pass, block(tile, pass)).ok());
  }
  EXPECT_EQ(reads_, 0) << "in order, nothing is read back";
  open(after);
  for (const auto& [tile, pass] : all_units()) {
    ASSERT_TRUE(after.note_committed(frame_key, tile, pass).ok());
  }
  EXPECT_EQ(reads_, 0) << "noting reads nothing";
  EXPECT_EQ(*before.mean_luminance(frame_key), *after.mean_luminance(frame_key));
  EXPECT_EQ(all_pixels(before), all_pixels(after));
}

TEST_F(FilmCacheTest, MeanLuminanceIsThatOfPassZeroOfTheWholeFrame) {
  FilmCache cache(kPlenty);
  open(cache);
  double sum = 0;
  for (std::int32_t tile = 0; tile < grid_->tile_count(); ++tile) {
    EXPECT_EQ(cache.mean_luminance(frame_key).status().code(),
              absl::StatusCode::kFailedPrecondition);
    const contract::PixelRect rect = grid_->rect(tile);
    TileSum alone(rect.width, rect.height, settings_.aovs);
    ASSERT_TRUE(alone.add(block(tile, 0), passes_[0]).ok());
    sum += alone.luminance_sum();
    ASSERT_TRUE(cache.add(frame_key, tile, 0, block(tile, 0)).ok());
  }
  EXPECT_EQ(*cache.mean_luminance(frame_key), sum / (70 * 50));
}

TEST_F(FilmCacheTest, MemoryStaysAtTheBudgetAndOneTileIsAlwaysHeld) {
  const std::int64_t one = TileSum(32, 32, settings_.aovs).bytes();
  FilmCache cache(2 * one);
  open(cache);
  for (const auto& [tile, pass] : all_units()) {
    ASSERT_TRUE(cache.add(frame_key, tile, pass, block(tile, pass)).ok());
    EXPECT_LE(cache.used_bytes(), 2 * one);
    EXPECT_GT(cache.used_bytes(), 0);
  }
  EXPECT_GT(reads_, 0) << "the frame does not fit, so tiles must have been rebuilt";
  cache.close_frame(frame_key);
  EXPECT_EQ(cache.used_bytes(), 0);
  EXPECT_FALSE(cache.is_open(frame_key));
}

TEST_F(FilmCacheTest, ProgressKnowsNoErrorUntilPassZeroIsWhole) {
  FilmCache cache(kPlenty);
  open(cache);
  const std::int32_t last = grid_->tile_count() - 1;
  for (std::int32_t tile = 0; tile < last; ++tile) {
    ASSERT_TRUE(cache.add(frame_key, tile, 0, block(tile, 0)).ok());
  }
  EXPECT_EQ(cache.running_estimate(frame_key).pixels, 0);
  ASSERT_TRUE(cache.add(frame_key, last, 0, block(last, 0)).ok());
  const ErrorEstimate after_first = cache.running_estimate(frame_key);
  EXPECT_EQ(after_first.pixels, 70 * 50);
  for (std::int32_t tile = 0; tile <= last; ++tile) {
    ASSERT_TRUE(cache.add(frame_key, tile, 1, block(tile, 1)).ok());
  }
  EXPECT_LT(cache.running_estimate(frame_key).error, after_first.error);
}

TEST_F(FilmCacheTest, RefusesWhatDoesNotBelongToTheFrame) {
  FilmCache cache(kPlenty);
  EXPECT_EQ(cache.add(frame_key, 0, 0, block(0, 0)).code(), absl::StatusCode::kNotFound);
  open(cache);
  EXPECT_EQ(cache.add(frame_key, 6, 0, block(0, 0)).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(cache.add(frame_key, 0, 3, block(0, 0)).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(cache.add(frame_key, 0, 1, block(0, 0)).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(cache.tile(frame_key, 0)->pass_count(), 0);
}

TEST_F(FilmCacheTest, FaultOfTheStoreReachesTheCaller) {
  FilmCache cache(kPlenty);
  cache.open_frame(frame_key, settings_, passes_, [](std::int32_t, std::int32_t) {
    return absl::StatusOr<FilmBlock>(absl::DataLossError("segment 3 is damaged"));
  });
  ASSERT_TRUE(cache.note_committed(frame_key, 0, 0).ok());
  EXPECT_EQ(cache.tile(frame_key, 0).status().code(), absl::StatusCode::kDataLoss);
}

TEST_F(FilmCacheTest, ThreadsMayAddAtOnce) {
  FilmCache cache(TileSum(32, 32, settings_.aovs).bytes() * 3), alone(kPlenty);
  open(cache);
  open(alone);
  const auto units = all_units();
  for (const auto& [tile, pass] : units) {
    ASSERT_TRUE(alone.add(frame_key, tile, pass, block(tile, pass)).ok());
  }
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t i = t; i < units.size(); i += 4) {
        const auto [tile, pass] = units[i];
        EXPECT_TRUE(cache.add(frame_key, tile, pass, block(tile, pass)).ok());
        cache.running_estimate(frame_key);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(all_pixels(cache), all_pixels(alone));
}

}  // namespace
}  // namespace tessera::server
