#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/tile_grid.h"

namespace tessera::server {

/// A block with made-up radiance that depends only on the arguments.
inline contract::FilmBlock made_block(const contract::PixelRect& rect, std::uint32_t aovs,
                                      std::int32_t pass_index, const contract::Pass& pass) {
  contract::FilmBlock block =
      contract::FilmBlock::zeros({rect.width, rect.height, aovs, pass_index == 0});
  std::mt19937 rng(static_cast<std::uint32_t>(rect.x * 7919 + rect.y * 104729 + pass_index));
  const auto u01 = [&rng] { return static_cast<double>(rng()) * 0x1p-32; };
  const int per_replicate = pass.sample_count / contract::kReplicates;
  for (float& value : block.rgb) value = static_cast<float>(per_replicate * (0.25 + u01()));
  for (float& value : block.alpha) value = static_cast<float>(pass.sample_count * u01());
  for (float& value : block.albedo) value = static_cast<float>(pass.sample_count * u01());
  for (float& value : block.normal) value = static_cast<float>(pass.sample_count * (u01() - 0.5));
  for (float& value : block.hits) value = static_cast<float>(pass.sample_count);
  for (float& value : block.traversal_cost) {
    value = std::floor(static_cast<float>(pass.sample_count * 100 * u01()));
  }
  for (float& value : block.depth) value = static_cast<float>(10 * u01());
  for (float& value : block.position) value = static_cast<float>(10 * u01() - 5);
  for (std::uint32_t& value : block.ids) value = static_cast<std::uint32_t>(rng());
  return block;
}

/// A square tile at the origin.
inline contract::PixelRect whole_tile(std::int32_t side) {
  return {0, 0, side, side};
}

}  // namespace tessera::server
