#include "contract/stopping_rule.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tessera::contract {
namespace {

/// The share of E² that may be filled; and, of what tiles that have stopped leave of it, the share
/// that the foreseen bound is made to meet with as few samples as it takes. What is foreseen is
/// then scaled up to fill all, so that noise in the estimates sends few tiles into another pass.
constexpr double kFill = 0.97, kAim = 0.9;
constexpr int kBisections = 40;

std::size_t at(std::int32_t index) {
  return static_cast<std::size_t>(index);
}

}  // namespace

StoppingRule::StoppingRule(double error, std::vector<Pass> passes,
                           std::vector<std::int64_t> tile_pixels)
    : target_(error * error),
      passes_(std::move(passes)),
      tiles_(tile_pixels.size()),
      looks_(std::max(1, last_pass())),
      unsettled_(passes_.size(), tile_count()),
      looked_(passes_.size(), false) {
  const std::int32_t always = std::min(kUnconditionalPasses, last_pass() + 1);
  for (std::size_t i = 0; i < tiles_.size(); ++i) {
    tiles_[i].pixels = tile_pixels[i];
    tiles_[i].pass_count = always;
    frame_pixels_ += static_cast<double>(tile_pixels[i]);
    wanted_samples_ += tile_pixels[i] * static_cast<std::int64_t>(samples_after(always - 1));
  }
}

double StoppingRule::samples_after(std::int32_t pass) const {
  return passes_[at(pass)].end();
}

std::int32_t StoppingRule::pass_count(std::int32_t tile) const {
  return tiles_[at(tile)].pass_count;
}

std::int64_t StoppingRule::expected_samples() const {
  return std::max(wanted_samples_, foreseen_samples_);
}

std::vector<StoppingRule::PassTarget> StoppingRule::take_changes() {
  return std::exchange(changes_, {});
}

void StoppingRule::add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums) {
  Tile& tile = tiles_[at(tile_index)];
  if (pass != tile.seen + 1 || pass >= tile.pass_count) return;
  tile.before = tile.newest;
  tile.newest = sums;
  tile.seen = pass;
  --unsettled_[at(pass)];
  decide(tile_index);
  for (std::int32_t look = 0; look + 2 <= last_pass(); ++look) {
    if (unsettled_[at(look)] == 0 && !looked_[at(look)]) take_look(look);
  }
}

bool StoppingRule::is_concentrated(const ErrorSums& sums) const {
  return effective_pixels(sums) < kFewestPixels && mean_scaled(sums) > heavy(sums.pixels);
}

/// Mean square at which a tile of so many pixels holds a thirtieth of what the frame may have: then
/// it matters by itself whether its figures can be trusted.
double StoppingRule::heavy(std::int64_t pixels) const {
  return target_ / kFewestPixels * (frame_pixels_ / static_cast<double>(pixels));
}

bool StoppingRule::may_stop(const Tile& tile) const {
  if (tile.newest.scaled == 0) return true;  // without noise; also where E² cannot be met
  if (is_concentrated(tile.newest) || !tile.others) return false;
  ErrorSums frame = *tile.others;
  frame.add(tile.newest);
  return upper_mean(frame, looks_) <= kFill * target_;
}

void StoppingRule::stop(Tile& tile) {
  tile.stopped = true;
  if (tile.seen == last_pass()) ++capped_tiles_;
  if (is_concentrated(tile.newest)) ++concentrated_tiles_;
  for (std::int32_t later = tile.seen + 1; later <= last_pass(); ++later) --unsettled_[at(later)];
}

void StoppingRule::decide(std::int32_t index) {
  Tile& tile = tiles_[at(index)];
  if (tile.stopped || tile.seen + 1 != tile.pass_count) return;
  const bool is_last = tile.seen == last_pass();
  if (!is_last && !looked_[at(tile.seen - 1)]) return;  // the look is not taken yet
  if (is_last || may_stop(tile)) {
    stop(tile);
  } else {
    wanted_samples_ += tile.pixels * passes_[at(tile.pass_count)].sample_count;
    ++tile.pass_count;
  }
  changes_.push_back({index, tile.pass_count, tile.stopped});
}

/// A tile is at most one pass ahead of a look, since the next one needs the look.
StoppingRule::Seen StoppingRule::as_of(const Tile& tile, std::int32_t pass) {
  if (tile.seen > pass) return {tile.before, true};
  return {tile.newest, !tile.stopped};
}

void StoppingRule::take_look(std::int32_t pass) {
  looked_[at(pass)] = true;
  share_out(pass, level(pass));
  for (std::int32_t tile = 0; tile < tile_count(); ++tile) {
    if (tiles_[at(tile)].seen == pass + 1) decide(tile);
  }
}

/// The pass after which a tile with these figures after `pass` is foreseen to stop, its square
/// falling as 1/n.
std::int32_t StoppingRule::foreseen_pass(const ErrorSums& sums, std::int32_t pass,
                                         double lambda) const {
  const double one_sample = mean_scaled(sums) * samples_after(pass);
  const bool is_thin = effective_pixels(sums) < kFewestPixels;
  std::int32_t end = pass + 1;
  for (; end < last_pass(); ++end) {
    const double foreseen = one_sample / samples_after(end);
    const bool waits = is_thin && foreseen > heavy(sums.pixels);
    if (!waits && foreseen / samples_after(end) <= lambda) break;
  }
  return end;
}

StoppingRule::Foreseen StoppingRule::foresee(std::int32_t pass, double lambda) const {
  Foreseen foreseen;
  for (const Tile& tile : tiles_) {
    const Seen seen = as_of(tile, pass);
    if (seen.is_active) {
      const std::int32_t end = foreseen_pass(seen.sums, pass, lambda);
      foreseen.active.add(seen.sums.scaled_by(samples_after(pass) / samples_after(end)));
    } else {
      foreseen.stopped.add(seen.sums);
    }
  }
  return foreseen;
}

/// The frame's bound if tiles that go on had `factor` times the foreseen square.
double StoppingRule::bound(const Foreseen& foreseen, double factor) const {
  ErrorSums total = foreseen.stopped;
  total.add(foreseen.active.scaled_by(factor));
  return upper_mean(total, looks_);
}

/// λ after a look: the largest at which the foreseen bound fills at most kAim of what is left of
/// E²; 0 if none does.
double StoppingRule::level(std::int32_t pass) const {
  double largest = 0;  // mean square ÷ samples of any tile that goes on
  for (const Tile& tile : tiles_) {
    const Seen seen = as_of(tile, pass);
    if (seen.is_active) largest = std::max(largest, mean_scaled(seen.sums) / samples_after(pass));
  }
  const auto shrunk = [&](std::int32_t end) {
    const double ratio = samples_after(pass) / samples_after(end);
    return ratio * ratio;
  };
  const double stopped = bound(foresee(pass, 0), 0);
  const double room = stopped + kAim * (kFill * target_ - stopped);
  double high = largest * shrunk(pass + 1);  // at which all stop after the next pass
  if (bound(foresee(pass, high)) <= room) return high;
  double low = high * shrunk(last_pass()) * shrunk(last_pass());
  if (bound(foresee(pass, low)) > room) return 0;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = std::sqrt(low * high);
    (bound(foresee(pass, middle)) <= room ? low : high) = middle;
  }
  return low;
}

/// By how much the foreseen squares of tiles that go on may grow until the bound is kFill E²;
/// 1 if it is above that already.
double StoppingRule::scale_to_fill(const Foreseen& foreseen) const {
  constexpr double kMost = 1024;
  const double room = kFill * target_;
  if (bound(foreseen) >= room) return 1;
  double low = 1, high = kMost;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = std::sqrt(low * high);
    (bound(foreseen, middle) <= room ? low : high) = middle;
  }
  return low;
}

/// Where E² cannot be met (λ = 0) no tile is told of the others: none stops because it did better
/// than was foreseen.
void StoppingRule::share_out(std::int32_t pass, double lambda) {
  Foreseen foreseen = foresee(pass, lambda);
  const double scale = scale_to_fill(foreseen);
  ErrorSums frame = foreseen.stopped;
  frame.add(foreseen.active.scaled_by(scale));
  foreseen_samples_ = 0;
  for (Tile& tile : tiles_) {
    const Seen seen = as_of(tile, pass);
    std::int32_t end = tile.pass_count - 1;
    if (seen.is_active) {
      end = foreseen_pass(seen.sums, pass, lambda);
      tile.others.reset();
      if (lambda > 0) {
        const double shrunk = scale * samples_after(pass) / samples_after(end);
        tile.others = frame.without(seen.sums.scaled_by(shrunk));
      }
    }
    foreseen_samples_ += tile.pixels * static_cast<std::int64_t>(samples_after(end));
  }
}

}  // namespace tessera::contract
