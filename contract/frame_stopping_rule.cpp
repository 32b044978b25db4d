#include "contract/frame_stopping_rule.h"

#include <algorithm>

#include "contract/index.h"

namespace tessera::contract {

FrameStoppingRule::FrameStoppingRule(double error, std::vector<Pass> passes,
                                     std::vector<std::int64_t> tile_pixels)
    : error_(error),
      passes_(std::move(passes)),
      tiles_(tile_pixels.size()),
      looks_(std::max(1, last_pass())),
      pass_(std::min(kUnconditionalPasses, last_pass() + 1) - 1),
      active_(static_cast<std::int32_t>(tiles_.size())),
      behind_(active_),
      expected_spp_(passes_[as_index(pass_)].end()) {
  for (std::size_t i = 0; i < tiles_.size(); ++i) {
    tiles_[i].pixels = tile_pixels[i];
    active_pixels_ += tile_pixels[i];
  }
}

std::int32_t FrameStoppingRule::pass_count(std::int32_t tile) const {
  const Tile& state = tiles_[as_index(tile)];
  return (state.stopped ? state.seen : pass_) + 1;
}

std::int64_t FrameStoppingRule::expected_samples() const {
  return stopped_samples_ +
         static_cast<std::int64_t>(static_cast<double>(active_pixels_) * expected_spp_);
}

void FrameStoppingRule::add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums) {
  Tile& tile = tiles_[as_index(tile_index)];
  if (tile.stopped || pass != tile.seen + 1 || pass > pass_) return;
  tile.seen = pass;
  if (pass < pass_) return;
  --behind_;
  if (sums.cautious == 0 || pass == last_pass()) stop(tile_index);
}

void FrameStoppingRule::stop(std::int32_t index) {
  Tile& tile = tiles_[as_index(index)];
  tile.stopped = true;
  --active_;
  active_pixels_ -= tile.pixels;
  stopped_samples_ += tile.pixels * passes_[as_index(tile.seen)].end();
  if (tile.seen == last_pass()) ++capped_tiles_;
  changes_.push_back({index, tile.seen + 1, true});
}

std::optional<std::int32_t> FrameStoppingRule::due_look() const {
  if (active_ == 0 || behind_ > 0) return std::nullopt;
  return pass_;
}

void FrameStoppingRule::end_look(bool is_met, double bound) {
  if (!due_look()) return;
  if (!is_met) {
    // As if the squared error fell as 1/n; that of a denoised frame falls more slowly.
    const double done = passes_[as_index(pass_)].end(), ratio = bound / error_;
    ++pass_;
    behind_ = active_;
    const double least = passes_[as_index(pass_)].end(), most = passes_.back().end();
    expected_spp_ = std::clamp(done * ratio * ratio, least, most);
  }
  const auto tile_count = static_cast<std::int32_t>(tiles_.size());
  for (std::int32_t tile = 0; tile < tile_count; ++tile) {
    if (tiles_[as_index(tile)].stopped) continue;
    if (is_met) {
      stop(tile);
    } else {
      changes_.push_back({tile, pass_ + 1, false});
    }
  }
}

}  // namespace tessera::contract
