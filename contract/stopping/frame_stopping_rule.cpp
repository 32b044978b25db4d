#include "contract/stopping/frame_stopping_rule.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tessera::contract {
namespace {

/// Fraction of E² at which a plan aims, because the squared error of a denoised frame falls more
/// slowly than 1/n, and a look that misses the target by little costs another pass.
constexpr double kAimOfFrame = 0.9;
constexpr int kLevelBisections = 40;

double fraction(double part, double whole) {
  return whole > 0 ? part / whole : 0;
}

/// Splits the bound² of a denoised frame into the squared error and the rest, its uncertainty.
double uncertainty(const FrameStoppingRule::LookResult& result) {
  return std::max(result.bound * result.bound - result.error * result.error, 0.0);
}

}  // namespace

FrameStoppingRule::FrameStoppingRule(double error, std::vector<Pass> passes,
                                     std::vector<std::int64_t> tile_pixels)
    : error_(error),
      passes_(std::move(passes)),
      tiles_(tile_pixels.size()),
      looks_(std::max(1, last_pass())),
      pass_(std::min(kUnconditionalPasses, last_pass() + 1) - 1),
      active_(static_cast<std::int32_t>(tiles_.size())),
      behind_(active_) {
  for (std::size_t i = 0; i < tiles_.size(); ++i) {
    tiles_[i].pixels = tile_pixels[i];
    tiles_[i].wanted = pass_;
    expect(tiles_[i], samples_after(pass_));
  }
}

std::int32_t FrameStoppingRule::pass_count(std::int32_t tile) const {
  return tiles_[as_index(tile)].wanted + 1;
}

/// Sets the samples that the tile is expected to end with.
void FrameStoppingRule::expect(Tile& tile, double samples_per_pixel) {
  expected_samples_ -= tile.expected_samples;
  tile.expected_samples =
      static_cast<std::int64_t>(static_cast<double>(tile.pixels) * samples_per_pixel);
  expected_samples_ += tile.expected_samples;
}

void FrameStoppingRule::add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums) {
  Tile& tile = tiles_[as_index(tile_index)];
  if (tile.stopped || pass != tile.seen + 1 || pass > tile.wanted) return;
  tile.seen = pass;
  tile.square = sums.cautious;
  tile.pixel_squares = sums.cautious_squares;
  if (pass < tile.wanted) return;
  --behind_;
  if (sums.cautious == 0 || pass == last_pass()) stop(tile_index);
}

void FrameStoppingRule::stop(std::int32_t index) {
  Tile& tile = tiles_[as_index(index)];
  tile.stopped = true;
  --active_;
  expect(tile, samples_after(tile.seen));
  if (tile.seen == last_pass()) ++capped_tiles_;
  changes_.push_back({index, tile.seen + 1, true});
}

void FrameStoppingRule::stop_all() {
  for (std::int32_t index = 0; index < static_cast<std::int32_t>(tiles_.size()); ++index) {
    if (!tiles_[as_index(index)].stopped) stop(index);
  }
}

/// Returns whether few pixels carry the error, and the bound would be above E at the last pass even
/// if its square fell as 1/n².
bool FrameStoppingRule::is_futile_after(const LookResult& result) const {
  const double samples = samples_after(pass_), left = samples / samples_after(last_pass());
  return result.is_concentrated && samples >= kMinFutileSamples && result.bound * left > error_;
}

std::optional<std::int32_t> FrameStoppingRule::due_look() const {
  if (active_ == 0 || behind_ > 0) return std::nullopt;
  return pass_;
}

void FrameStoppingRule::end_look(const LookResult& result) {
  if (!due_look()) return;
  const auto tile_count = static_cast<std::int32_t>(tiles_.size());
  if (result.bound <= error_) return stop_all();
  if (is_futile_after(result)) {
    is_futile_ = true;
    return stop_all();
  }
  const std::optional<double> level = plan(result);
  // Without a plan, as if the squared error of the frame fell as 1/n.
  const double over = result.bound / error_, without_plan = samples_after(pass_) * over * over;
  ++pass_;
  for (std::int32_t index = 0; index < tile_count; ++index) {
    Tile& tile = tiles_[as_index(index)];
    if (tile.stopped) continue;
    const std::int32_t end = level ? planned_pass(tile, *level) : last_pass();
    expect(tile, level ? samples_after(end)
                       : std::clamp(without_plan, samples_after(pass_), samples_after(end)));
    if (end == tile.seen) continue;  // it waits
    tile.wanted = std::min(end, pass_);
    ++behind_;
    changes_.push_back({index, tile.wanted + 1, false});
  }
}

/// Returns the largest level at which the frame is predicted to meet its bound; nullopt if all
/// tiles should continue: they get their last pass, or no plan can help.
std::optional<double> FrameStoppingRule::plan(const LookResult& result) {
  if (pass_ + 1 == last_pass()) return std::nullopt;
  set_weights(result);
  // All tiles get the last pass at the lower level, and none another one at the upper level.
  double low = std::numeric_limits<double>::infinity(), high = 0;
  for (const Tile& tile : tiles_) {
    if (tile.stopped) continue;
    low = std::min(low, worth(tile, last_pass()));
    high = std::max(high, worth(tile, tile.seen));
  }
  const auto meets_bound = [&](double level) {
    return predicted_square(result, level) <= kAimOfFrame * error_ * error_;
  };
  if (!meets_bound(low)) return std::nullopt;
  for (int i = 0; i < kLevelBisections; ++i) {
    const double middle = std::sqrt(low * high);
    (meets_bound(middle) ? low : high) = middle;
  }
  return low;
}

/// The squared error of the frame is divided among the tiles as the raw one is, and its uncertainty
/// as the sum of squares is.
void FrameStoppingRule::set_weights(const LookResult& result) {
  double square = 0, pixel_squares = 0;
  for (const Tile& tile : tiles_) {
    if (tile.stopped) continue;
    square += tile.square;
    pixel_squares += tile.pixel_squares;
  }
  for (Tile& tile : tiles_) {
    if (tile.stopped) continue;
    const double share = result.error * result.error * fraction(tile.square, square) +
                         uncertainty(result) * fraction(tile.pixel_squares, pixel_squares);
    tile.weight = share * samples_after(tile.seen) / static_cast<double>(tile.pixels);
  }
}

/// Returns by how much a further sample in the tile after `pass` reduces the bound² of the frame.
double FrameStoppingRule::worth(const Tile& tile, std::int32_t pass) const {
  return tile.weight / samples_after(pass) / samples_after(pass);
}

/// Returns the first pass, from the tile's latest on, after which a sample is worth at most
/// `level`; the last if there is none.
std::int32_t FrameStoppingRule::planned_pass(const Tile& tile, double level) const {
  std::int32_t end = tile.seen;
  while (end < last_pass() && worth(tile, end) > level) ++end;
  return end;
}

/// Returns the bound² of the frame when each tile has the passes planned at `level`.
double FrameStoppingRule::predicted_square(const LookResult& result, double level) const {
  double square = 0, pixel_squares = 0, later_square = 0, later_pixel_squares = 0;
  for (const Tile& tile : tiles_) {
    if (tile.stopped) continue;
    const double left = samples_after(tile.seen) / samples_after(planned_pass(tile, level));
    square += tile.square;
    pixel_squares += tile.pixel_squares;
    later_square += tile.square * left;
    later_pixel_squares += tile.pixel_squares * left * left;
  }
  return result.error * result.error * fraction(later_square, square) +
         uncertainty(result) * std::sqrt(fraction(later_pixel_squares, pixel_squares));
}

}  // namespace tessera::contract
