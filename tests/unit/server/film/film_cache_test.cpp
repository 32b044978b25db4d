#include "server/film/film_cache.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <future>
#include <map>
#include <random>
#include <set>
#include <thread>

#include "image/metrics/image_metrics.h"
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
  void open(FilmCache& cache, ReferenceReader reference = {}) {
    cache.open_frame(
        frame_key, settings_,
        [this](std::int32_t tile, std::int32_t pass) {
          ++reads_;
          return absl::StatusOr<FilmBlock>(block(tile, pass));
        },
        std::move(reference));
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
  /// All results of a tile, for comparison bit for bit.
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
    values.insert(values.end(), tile.first_sample().depth.begin(), tile.first_sample().depth.end());
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

TEST_F(FilmCacheTest, OrderDuplicatesAndMemoryKeepBits) {
  // Hard case 69.
  std::vector<float> expected;
  std::vector<double> errors;
  std::mt19937 rng(69);
  for (int trial = 0; trial < 12; ++trial) {
    FilmCache cache(trial % 3 == 2 ? 1 : kPlenty);  // 1 byte: tiles are always rebuilt
    open(cache);
    auto units = all_units();
    if (trial > 0) std::shuffle(units.begin(), units.end(), rng);
    if (trial % 2 == 1) {  // some blocks are added twice
      for (int copies = 0; copies < 5; ++copies) units.push_back(units[rng() % units.size()]);
    }
    for (const auto& [tile, pass] : units) {
      ASSERT_TRUE(cache.add(frame_key, tile, pass, block(tile, pass)).ok());
    }
    std::vector<double> figures = {*cache.mean_luminance(frame_key)};
    const std::vector<float> pixels = all_pixels(cache, trial % 4 < 2);
    for (std::int32_t pass = 0; pass < 3; ++pass) {
      const ErrorEstimate estimate = cache.after_pass(frame_key, pass).estimate;
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

TEST_F(FilmCacheTest, RestartFromJournalKeepsBits) {
  FilmCache before(kPlenty), after(kPlenty);
  open(before);
  for (const auto& [tile, pass] : all_units()) {
    ASSERT_TRUE(before.add(frame_key, tile, pass, block(tile, pass)).ok());
  }
  EXPECT_EQ(reads_, 0) << "in order, nothing is read back";
  open(after);
  for (const auto& [tile, pass] : all_units()) {
    ASSERT_TRUE(after.record_committed(frame_key, tile, pass).ok());
  }
  EXPECT_EQ(reads_, 0) << "recording a block must not read it";
  EXPECT_EQ(*before.mean_luminance(frame_key), *after.mean_luminance(frame_key));
  EXPECT_EQ(all_pixels(before), all_pixels(after));
}

TEST_F(FilmCacheTest, MeanLuminanceCoversWholePassZero) {
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

TEST_F(FilmCacheTest, MemoryStaysWithinBudget) {
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

TEST_F(FilmCacheTest, ErrorIsUnknownUntilPassZeroIsWhole) {
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

TEST_F(FilmCacheTest, TrueErrorPerPassMatchesImage) {
  std::vector<float> reference, image(std::size_t{4} * 70 * 50);
  std::mt19937 rng(7);
  std::uniform_real_distribution<float> uniform(0, 2);
  for (int i = 0; i < 4 * 70 * 50; ++i) reference.push_back(uniform(rng));
  for (const std::int64_t budget : {std::int64_t{1}, kPlenty}) {
    FilmCache cache(budget);
    open(cache, [&](const contract::PixelRect& rect) {
      std::vector<float> pixels;
      for (std::int32_t y = rect.y; y < rect.y + rect.height; ++y) {
        const auto row = reference.begin() + 4 * (y * 70 + rect.x);
        pixels.insert(pixels.end(), row, row + 4 * rect.width);
      }
      return absl::StatusOr<std::vector<float>>(pixels);
    });
    for (std::int32_t pass = 0; pass < 3; ++pass) {
      for (std::int32_t tile = 0; tile < grid_->tile_count(); ++tile) {
        EXPECT_FALSE(cache.after_pass(frame_key, 0).truth && pass == 0);
        ASSERT_TRUE(cache.add(frame_key, tile, pass, block(tile, pass)).ok());
      }
      for (std::int32_t tile = 0; tile < grid_->tile_count(); ++tile) {
        const auto sum = cache.tile(frame_key, tile);
        ASSERT_TRUE(sum.ok());
        const contract::PixelRect rect = grid_->rect(tile);
        for (std::int64_t pixel = 0; pixel < sum->pixel_count(); ++pixel) {
          const std::int64_t x = rect.x + pixel % rect.width, y = rect.y + pixel / rect.width;
          sum->rgba(pixel, std::span<float, 4>(&image[static_cast<std::size_t>(4 * (y * 70 + x))],
                                               std::size_t{4}));
        }
      }
      const double m = *cache.mean_luminance(frame_key);
      const auto difference = contract::compare_images({70, 50, image}, {70, 50, reference}, m);
      ASSERT_TRUE(difference.ok()) << difference.status();
      const auto truth = cache.after_pass(frame_key, pass).truth;
      ASSERT_TRUE(truth && truth->error) << "pass " << pass;
      const auto near = [&](double figure, double expected) {
        EXPECT_NEAR(figure, expected, 1e-12 * expected) << "pass " << pass;  // other order of sums
      };
      near(*truth->error, *difference->error);
      near(truth->relmse, difference->relmse);
      near(truth->rmse, difference->rmse);
    }
  }
}

TEST_F(FilmCacheTest, UnreadableReferenceGivesNoError) {
  FilmCache cache(kPlenty);
  open(cache, [](const contract::PixelRect&) -> absl::StatusOr<std::vector<float>> {
    return absl::DataLossError("gone");
  });
  for (const auto& [tile, pass] : all_units()) {
    ASSERT_TRUE(cache.add(frame_key, tile, pass, block(tile, pass)).ok());
  }
  EXPECT_FALSE(cache.after_pass(frame_key, 2).truth);
  EXPECT_GT(cache.after_pass(frame_key, 2).estimate.error, 0);
}

TEST_F(FilmCacheTest, RejectsUnitsOutsideFrame) {
  FilmCache cache(kPlenty);
  EXPECT_EQ(cache.add(frame_key, 0, 0, block(0, 0)).code(), absl::StatusCode::kNotFound);
  open(cache);
  EXPECT_EQ(cache.add(frame_key, 6, 0, block(0, 0)).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(cache.add(frame_key, 0, 3, block(0, 0)).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(cache.add(frame_key, 0, 1, block(0, 0)).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(cache.tile(frame_key, 0)->pass_count(), 0);
}

TEST_F(FilmCacheTest, StoreErrorReachesCaller) {
  FilmCache cache(kPlenty);
  cache.open_frame(frame_key, settings_, [](std::int32_t, std::int32_t) {
    return absl::StatusOr<FilmBlock>(absl::DataLossError("segment 3 is damaged"));
  });
  ASSERT_TRUE(cache.record_committed(frame_key, 0, 0).ok());
  EXPECT_EQ(cache.tile(frame_key, 0).status().code(), absl::StatusCode::kDataLoss);
}

TEST_F(FilmCacheTest, ConcurrentAddsMatchSerialOnes) {
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

TEST_F(FilmCacheTest, ReadingAFrameDoesNotDelayAnother) {
  FilmCache cache(kPlenty);
  std::promise<void> is_reading, may_end;
  cache.open_frame({"job", 1}, settings_, [&](std::int32_t tile, std::int32_t pass) {
    is_reading.set_value();
    const auto status = may_end.get_future().wait_for(std::chrono::minutes(1));
    EXPECT_EQ(status, std::future_status::ready);
    return absl::StatusOr<FilmBlock>(block(tile, pass));
  });
  ASSERT_TRUE(cache.record_committed({"job", 1}, 0, 0).ok());
  open(cache);
  std::thread reader([&] { EXPECT_TRUE(cache.tile({"job", 1}, 0).ok()); });
  is_reading.get_future().wait();
  EXPECT_TRUE(cache.add(frame_key, 0, 0, block(0, 0)).ok());
  may_end.set_value();
  reader.join();
  EXPECT_EQ(cache.open_frames("job").size(), 2u);
}

/// The same frame with a target error: its radiance is noise of standard deviation 0.29 about 0.75,
/// summed as if of many samples, so a tile's error falls only with the number of passes.
class ErrorFilmTest : public FilmCacheTest {
 protected:
  ErrorFilmTest() {
    settings_.spp = 512;
    settings_.error = 0.11;
    passes_ = contract::schedule(settings_);
  }
  using Unit = std::pair<std::int32_t, std::int32_t>;
  using PassCounts = std::map<std::int32_t, std::int32_t>;
  using Targets = std::vector<contract::PassRule::PassTarget>;

  /// Returns the new targets. A look takes the error of the raw frame for that of the denoised one.
  absl::StatusOr<Targets> take_targets(FilmCache& cache) const {
    absl::StatusOr<Targets> targets = cache.take_pass_targets(frame_key);
    while (targets.ok() && cache.is_look_due(frame_key)) {
      const ErrorEstimate raw = cache.running_estimate(frame_key);
      cache.end_look(frame_key, {raw.error, raw.error_upper95});
      const absl::StatusOr<Targets> more = cache.take_pass_targets(frame_key);
      if (!more.ok()) return more.status();
      targets->insert(targets->end(), more->begin(), more->end());
    }
    return targets;
  }
  /// Adds the wanted blocks in an order seeded by `seed` until every tile has stopped; continues
  /// with a new cache after every `restart_after` blocks. Returns the number of passes of each
  /// tile.
  PassCounts render(std::uint32_t seed, int restart_after, std::int64_t budget,
                    std::vector<float>& pixels) {
    std::mt19937 rng(seed);
    auto cache = std::make_unique<FilmCache>(budget);
    open(*cache);
    std::vector<Unit> waiting, committed;
    PassCounts counts;
    std::set<std::int32_t> final_tiles;
    for (std::int32_t tile = 0; tile < grid_->tile_count(); ++tile) {
      counts[tile] = 2;
      waiting.insert(waiting.end(), {{tile, 0}, {tile, 1}});
    }
    while (!waiting.empty()) {
      std::swap(waiting[rng() % waiting.size()], waiting.back());
      const Unit unit = waiting.back();
      waiting.pop_back();
      if (restart_after > 0 && committed.size() % static_cast<std::size_t>(restart_after) == 0) {
        cache = std::make_unique<FilmCache>(budget);
        open(*cache);
        for (const Unit& each : committed) {
          EXPECT_TRUE(cache->record_committed(frame_key, each.first, each.second).ok());
        }
      }
      committed.push_back(unit);
      // The result must be the same if this block comes before the film is asked after the restart.
      if (seed % 2 == 0) {
        EXPECT_TRUE(cache->take_pass_targets(frame_key).ok());
      }
      EXPECT_TRUE(
          cache->add(frame_key, unit.first, unit.second, block(unit.first, unit.second)).ok());
      const auto demands = take_targets(*cache);
      EXPECT_TRUE(demands.ok()) << demands.status();
      if (!demands.ok()) break;
      for (const auto& demand : *demands) {
        for (std::int32_t& count = counts[demand.tile]; count < demand.pass_count; ++count) {
          waiting.emplace_back(demand.tile, count);
        }
        if (demand.is_final) final_tiles.insert(demand.tile);
      }
    }
    for (const auto& [tile, count] : counts) {
      const auto sum = cache->tile(frame_key, tile);
      EXPECT_TRUE(sum.ok() && sum->pass_count() == count);
      const std::vector<float> more = pixels_of(*sum);
      pixels.insert(pixels.end(), more.begin(), more.end());
    }
    EXPECT_EQ(final_tiles.size(), counts.size());
    std::int32_t most_passes = 0;
    for (const auto& [tile, count] : counts) most_passes = std::max(most_passes, count);
    EXPECT_EQ(cache->max_samples(frame_key),
              passes_[static_cast<std::size_t>(most_passes - 1)].end());
    return counts;
  }
  void expect_same_decisions();
};

void ErrorFilmTest::expect_same_decisions() {
  std::vector<float> expected_pixels;
  const PassCounts expected = render(0, 0, kPlenty, expected_pixels);
  std::set<std::int32_t> kinds;
  for (const auto& [tile, count] : expected) kinds.insert(count);
  EXPECT_GT(kinds.size(), 1u) << "the test needs tiles with different pass counts";
  for (std::uint32_t seed = 1; seed < 16; ++seed) {
    std::vector<float> pixels;
    const std::int64_t budget = seed % 3 == 0 ? 1 : kPlenty;
    EXPECT_EQ(render(seed, static_cast<int>(seed % 5), budget, pixels), expected)
        << "seed " << seed;
    EXPECT_EQ(pixels, expected_pixels) << "seed " << seed;
  }
}

TEST_F(ErrorFilmTest, OrderMemoryAndRestartsKeepDecisions) {
  expect_same_decisions();
}

TEST_F(ErrorFilmTest, OrderAndRestartsKeepDecisionsIfDenoised) {
  settings_.denoise = true;
  settings_.error = 0.135;  // met when some tiles have a third pass
  expect_same_decisions();
}

TEST_F(ErrorFilmTest, FixedCountHasNoPassTargets) {
  settings_.error.reset();
  FilmCache cache(kPlenty);
  open(cache);
  ASSERT_TRUE(cache.take_pass_targets(frame_key).ok());
  EXPECT_TRUE(cache.take_pass_targets(frame_key)->empty());
  EXPECT_FALSE(cache.expected_samples(frame_key));
  EXPECT_EQ(cache.stopping(frame_key).looks, 1);
}

TEST_F(ErrorFilmTest, DenoisedFrameWaitsForItsLook) {
  const contract::FrameStoppingRule::LookResult out_of_reach{5, 10};  // all tiles continue
  settings_.denoise = true;
  FilmCache cache(kPlenty);
  open(cache);
  const auto add_pass = [&](std::int32_t pass) {
    for (std::int32_t tile = 0; tile < grid_->tile_count(); ++tile) {
      EXPECT_FALSE(cache.is_look_due(frame_key)) << "tile " << tile << " of pass " << pass;
      EXPECT_TRUE(cache.add(frame_key, tile, pass, block(tile, pass)).ok());
      EXPECT_TRUE(cache.take_pass_targets(frame_key)->empty());
    }
  };
  add_pass(0);
  add_pass(1);
  ASSERT_TRUE(cache.is_look_due(frame_key));
  cache.end_look(frame_key, out_of_reach);
  const auto targets = cache.take_pass_targets(frame_key);
  ASSERT_TRUE(targets.ok());
  ASSERT_EQ(targets->size(), static_cast<std::size_t>(grid_->tile_count()));
  EXPECT_EQ(targets->front().pass_count, 3);
  EXPECT_FALSE(targets->front().is_final);

  // After a restart the looks are taken again, on the sums that they were taken on.
  FilmCache restarted(kPlenty);
  open(restarted);
  add_pass(2);
  for (std::int32_t tile = 0; tile < grid_->tile_count(); ++tile) {
    for (std::int32_t pass = 0; pass < 3; ++pass) {
      ASSERT_TRUE(restarted.record_committed(frame_key, tile, pass).ok());
    }
  }
  ASSERT_TRUE(restarted.take_pass_targets(frame_key).ok());
  ASSERT_TRUE(restarted.is_look_due(frame_key));
  EXPECT_EQ(restarted.tile(frame_key, 0)->pass_count(), 2);
  restarted.end_look(frame_key, out_of_reach);
  ASSERT_TRUE(restarted.take_pass_targets(frame_key).ok());
  ASSERT_TRUE(restarted.is_look_due(frame_key));
  EXPECT_EQ(restarted.tile(frame_key, 0)->pass_count(), 3);
}

}  // namespace
}  // namespace tessera::server
