#include "tests/bench/coordinator/simulated_block.h"

#include <random>
#include <span>

#include "contract/tile_grid.h"
#include "contract/version.h"

namespace tessera::bench {
namespace {

constexpr float kStep = 1.0F / (1 << 20);

}  // namespace

SimulatedFilm::SimulatedFilm(const contract::RenderSettings& settings)
    : settings_(settings), passes_(contract::fixed_schedule(settings.spp)) {
  std::mt19937 rng(20261121);
  for (std::size_t pass = 0; pass < passes_.size(); ++pass) {
    contract::FilmBlock block = contract::FilmBlock::zeros(
        {.width = settings.tile, .height = settings.tile, .aovs = 0, .first_pass = pass == 0});
    for (float& value : block.rgb) {
      value = 0.5F + kStep * static_cast<float>(rng() % (3U << 19));
    }
    for (float& value : block.alpha) value = static_cast<float>(passes_[pass].sample_count);
    templates_.push_back(std::move(block));
  }
  block_bytes_ = contract::film_block_bytes(templates_.front().shape);
}

contract::FilmBlock SimulatedFilm::pass_block(std::int32_t tile, std::size_t pass) const {
  contract::FilmBlock block = templates_[pass];
  block.rgb.front() = 0.5F + kStep * static_cast<float>(tile % (3 << 19));
  return block;
}

std::string SimulatedFilm::block(std::int32_t tile, std::int32_t pass) const {
  return contract::encode(pass_block(tile, static_cast<std::size_t>(pass)));
}

std::int64_t SimulatedFilm::unit_count() const {
  return std::int64_t{contract::TileGrid(settings_).tile_count()} *
         static_cast<std::int64_t>(passes_.size());
}

contract::Digest SimulatedFilm::expected_pixels() const {
  const contract::TileGrid grid(settings_);
  const auto side = static_cast<std::size_t>(settings_.tile);
  const std::int32_t samples = passes_.back().first_sample + passes_.back().sample_count;
  const auto mean_rgb = [&](std::size_t pixel, std::size_t channel, std::int32_t tile) {
    double sum = 0;
    for (std::size_t pass = 0; pass < templates_.size(); ++pass) {
      for (std::size_t r = 0; r < contract::kReplicates; ++r) {
        const std::size_t at = (pixel * contract::kReplicates + r) * 3 + channel;
        sum += at == 0 ? 0.5F + kStep * static_cast<float>(tile % (3 << 19))
                       : templates_[pass].rgb[at];
      }
    }
    return static_cast<float>(sum / samples);
  };
  // All tiles share the pixels of one; only the red of the first pixel differs.
  std::vector<float> tile_rgba(side * side * 4);
  for (std::size_t pixel = 0; pixel < side * side; ++pixel) {
    for (std::size_t c = 0; c < 3; ++c) tile_rgba[pixel * 4 + c] = mean_rgb(pixel, c, 0);
    tile_rgba[pixel * 4 + 3] = 1;
  }
  contract::Hasher hasher;
  for (std::int32_t row = 0; row < grid.rows(); ++row) {
    for (std::size_t y = 0; y < side; ++y) {
      for (std::int32_t column = 0; column < grid.columns(); ++column) {
        std::span<float> line(&tile_rgba[y * side * 4], side * 4);
        if (y == 0) line[0] = mean_rgb(0, 0, grid.index_at(column, row));
        hasher.update(std::as_bytes(line));
      }
    }
  }
  return hasher.finish();
}

}  // namespace tessera::bench
