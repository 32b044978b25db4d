#include "contract/stopping/stopping_rule.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "contract/index.h"

namespace tessera::contract {
namespace {

/// kFill: fraction of E² that may be used. kAim: fraction of the budget left by stopped tiles at
/// which the predicted bound aims with fewest samples. The prediction is then scaled up to the
/// whole budget, so that noise in the estimates makes few tiles need another pass.
constexpr double kFill = 0.97, kAim = 0.9;
constexpr int kBisections = 40;
/// Samples per pixel before which no frame gives up: the first of rare events may be yet to come.

}  // namespace

StoppingRule::StoppingRule(double error, std::vector<Pass> passes,
                           std::vector<std::int64_t> tile_pixels)
    : target_(error * error),
      passes_(std::move(passes)),
      tiles_(tile_pixels.size()),
      looks_(std::max(1, last_pass())),
      unsettled_(passes_.size(), tile_count()),
      look_taken_(passes_.size(), false) {
  const std::int32_t always = std::min(kUnconditionalPasses, last_pass() + 1);
  for (std::size_t i = 0; i < tiles_.size(); ++i) {
    tiles_[i].pixels = tile_pixels[i];
    tiles_[i].pass_count = always;
    frame_pixels_ += static_cast<double>(tile_pixels[i]);
    wanted_samples_ += tile_pixels[i] * static_cast<std::int64_t>(samples_after(always - 1));
  }
}

double StoppingRule::samples_after(std::int32_t pass) const {
  return passes_[as_index(pass)].end();
}

std::int32_t StoppingRule::pass_count(std::int32_t tile) const {
  return tiles_[as_index(tile)].pass_count;
}

std::int64_t StoppingRule::expected_samples() const {
  return std::max(wanted_samples_, predicted_samples_);
}

std::vector<PassRule::PassTarget> StoppingRule::take_changes() {
  return std::exchange(changes_, {});
}

void StoppingRule::add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums) {
  Tile& tile = tiles_[as_index(tile_index)];
  if (pass != tile.seen + 1 || pass >= tile.pass_count) return;
  tile.before = tile.newest;
  tile.newest = sums;
  tile.seen = pass;
  --unsettled_[as_index(pass)];
  decide(tile_index);
  for (std::int32_t look = 0; look + 2 <= last_pass(); ++look) {
    if (unsettled_[as_index(look)] == 0 && !look_taken_[as_index(look)]) take_look(look);
  }
}

bool StoppingRule::may_stop(const Tile& tile) const {
  if (tile.newest.cautious == 0) return true;  // without noise; also if E² cannot be met
  if (futile_look_ && *futile_look_ < tile.seen) return true;
  if (!tile.others) return false;
  ErrorSums frame = *tile.others;
  frame.add(tile.newest);
  return upper_mean(frame, looks_) <= kFill * target_;
}

void StoppingRule::stop(Tile& tile) {
  tile.stopped = true;
  if (tile.seen == last_pass()) ++capped_tiles_;
  for (std::int32_t later = tile.seen + 1; later <= last_pass(); ++later)
    --unsettled_[as_index(later)];
}

void StoppingRule::decide(std::int32_t index) {
  Tile& tile = tiles_[as_index(index)];
  if (tile.stopped || tile.seen + 1 != tile.pass_count) return;
  const bool is_last = tile.seen == last_pass();
  if (!is_last && !look_taken_[as_index(tile.seen - 1)])
    return;  // that look has not been taken yet
  if (is_last || may_stop(tile)) {
    stop(tile);
  } else {
    wanted_samples_ += tile.pixels * passes_[as_index(tile.pass_count)].sample_count;
    ++tile.pass_count;
  }
  changes_.push_back({index, tile.pass_count, tile.stopped});
}

/// A tile is at most one pass ahead of a look, because the next pass depends on it.
StoppingRule::Seen StoppingRule::as_of(const Tile& tile, std::int32_t pass) {
  if (tile.seen > pass) return {tile.before, true};
  return {tile.newest, !tile.stopped};
}

void StoppingRule::take_look(std::int32_t pass) {
  look_taken_[as_index(pass)] = true;
  set_predictions(pass, level(pass));
  if (!futile_look_ && is_futile_after(pass)) futile_look_ = pass;
  for (std::int32_t tile = 0; tile < tile_count(); ++tile) {
    if (tiles_[as_index(tile)].seen == pass + 1) decide(tile);
  }
}

/// Returns whether few pixels carry the error after `pass`, and the bound would be above E² at the
/// last pass even if it fell as 1/n².
bool StoppingRule::is_futile_after(std::int32_t pass) const {
  if (samples_after(pass) < kMinFutileSamples) return false;
  ErrorSums frame;
  for (const Tile& tile : tiles_) frame.add(as_of(tile, pass).sums);
  const double left = samples_after(pass) / samples_after(last_pass());
  return effective_pixels(frame) < kMinEffectivePixels &&
         upper_mean(frame, looks_) * left * left > target_;
}

/// Returns the pass after which a tile with these sums after `pass` is predicted to stop, with its
/// square falling as 1/n. A tile whose error is in few pixels is planned to continue until it has
/// little of the budget, since these pixels widen the bound.
std::int32_t StoppingRule::predicted_pass(const ErrorSums& sums, std::int32_t pass,
                                          double lambda) const {
  const double one_sample = mean_cautious(sums) * samples_after(pass);
  const bool is_thin = effective_pixels(sums) < kMinEffectivePixels;
  // The mean square at which the tile has a thirtieth of the frame's budget.
  const double limit =
      target_ / kMinEffectivePixels * (frame_pixels_ / static_cast<double>(sums.pixels));
  std::int32_t end = pass + 1;
  for (; end < last_pass(); ++end) {
    const double predicted = one_sample / samples_after(end);
    const bool waits = is_thin && predicted > limit;
    if (!waits && predicted / samples_after(end) <= lambda) break;
  }
  return end;
}

StoppingRule::Prediction StoppingRule::predict(std::int32_t pass, double lambda) const {
  Prediction predicted;
  for (const Tile& tile : tiles_) {
    const Seen seen = as_of(tile, pass);
    if (seen.is_active) {
      const std::int32_t end = predicted_pass(seen.sums, pass, lambda);
      predicted.active.add(seen.sums.scaled_by(samples_after(pass) / samples_after(end)));
    } else {
      predicted.stopped.add(seen.sums);
    }
  }
  return predicted;
}

/// Returns the frame's bound if active tiles had `factor` times the predicted square.
double StoppingRule::bound(const Prediction& predicted, double factor) const {
  ErrorSums total = predicted.stopped;
  total.add(predicted.active.scaled_by(factor));
  return upper_mean(total, looks_);
}

/// Returns λ after a look: the largest at which the predicted bound uses at most kAim of the
/// remaining budget; 0 if there is none.
double StoppingRule::level(std::int32_t pass) const {
  double largest = 0;  // mean square ÷ samples, over active tiles
  for (const Tile& tile : tiles_) {
    const Seen seen = as_of(tile, pass);
    if (seen.is_active) largest = std::max(largest, mean_cautious(seen.sums) / samples_after(pass));
  }
  const auto shrunk = [&](std::int32_t end) {
    const double ratio = samples_after(pass) / samples_after(end);
    return ratio * ratio;
  };
  const double stopped = bound(predict(pass, 0), 0);
  const double room = stopped + kAim * (kFill * target_ - stopped);
  double high = largest * shrunk(pass + 1);  // at which all tiles stop after the next pass
  if (bound(predict(pass, high)) <= room) return high;
  double low = high * shrunk(last_pass()) * shrunk(last_pass());
  if (bound(predict(pass, low)) > room) return 0;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = std::sqrt(low * high);
    (bound(predict(pass, middle)) <= room ? low : high) = middle;
  }
  return low;
}

/// Returns the factor by which the predicted squares of active tiles may grow until the bound is
/// kFill E²; 1 if it is above that already.
double StoppingRule::scale_to_fill(const Prediction& predicted) const {
  constexpr double kMaxFactor = 1024;
  const double room = kFill * target_;
  if (bound(predicted) >= room) return 1;
  double low = 1, high = kMaxFactor;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = std::sqrt(low * high);
    (bound(predicted, middle) <= room ? low : high) = middle;
  }
  return low;
}

/// If E² cannot be met (λ = 0), tiles get no prediction of the others, so none stops because it did
/// better than predicted.
void StoppingRule::set_predictions(std::int32_t pass, double lambda) {
  Prediction predicted = predict(pass, lambda);
  const double scale = scale_to_fill(predicted);
  ErrorSums frame = predicted.stopped;
  frame.add(predicted.active.scaled_by(scale));
  predicted_samples_ = 0;
  for (Tile& tile : tiles_) {
    const Seen seen = as_of(tile, pass);
    std::int32_t end = tile.pass_count - 1;
    if (seen.is_active) {
      end = predicted_pass(seen.sums, pass, lambda);
      tile.others.reset();
      if (lambda > 0) {
        const double shrunk = scale * samples_after(pass) / samples_after(end);
        tile.others = frame.without(seen.sums.scaled_by(shrunk));
      }
    }
    predicted_samples_ += tile.pixels * static_cast<std::int64_t>(samples_after(end));
  }
}

}  // namespace tessera::contract
