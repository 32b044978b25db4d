#include "server/film/film_cache.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/index.h"
#include "contract/stopping/stopping_rule.h"

namespace tessera::server {
namespace {

constexpr std::int32_t kFirstFrame = std::numeric_limits<std::int32_t>::min();

template <typename Frame>
std::int32_t pass_count(const Frame& frame) {
  return static_cast<std::int32_t>(frame.passes.size());
}

std::string label(const FrameKey& key) {
  return absl::StrCat("job ", key.job_id, ", frame ", key.frame);
}

/// `has_scale`: m is known and positive.
TrueErrorStats figures_of(const TrueSums& sums, std::int64_t pixels, bool has_scale) {
  const double values = 3 * static_cast<double>(pixels);
  TrueErrorStats figures{std::sqrt(sums.squared / values), sums.relative / values, std::nullopt};
  if (has_scale) figures.error = std::sqrt(sums.scaled / values);
  return figures;
}

}  // namespace

void FilmCache::open_frame(const FrameKey& key, const contract::RenderSettings& settings,
                           BlockReader reader, ReferenceReader reference) {
  contract::TileGrid grid(settings);
  std::vector<contract::Pass> passes = contract::schedule(settings);
  const std::int32_t tile_count = grid.tile_count();
  Tile tile;
  tile.committed.resize(passes.size());
  tile.error.resize(passes.size());
  if (reference) tile.truth.resize(passes.size());
  const std::shared_ptr<Frame> frame(
      new Frame{key, std::move(grid), settings.aovs, std::move(passes), std::move(reader)});
  {
    const MutexLock lock(frame->mutex);
    frame->reference = std::move(reference);
    frame->tiles.assign(contract::as_index(tile_count), tile);
    frame->tiles_without_luminance = tile_count;
    if (settings.error) add_rule(settings, *frame);
  }
  const MutexLock lock(mutex_);
  frames_.emplace(key, frame);
}

void FilmCache::add_rule(const contract::RenderSettings& settings, Frame& frame) {
  std::vector<std::int64_t> pixels;
  for (std::int32_t tile = 0; tile < frame.grid.tile_count(); ++tile) {
    const contract::PixelRect rect = frame.grid.rect(tile);
    pixels.push_back(std::int64_t{rect.width} * rect.height);
  }
  if (settings.denoise) {
    auto rule = std::make_unique<contract::FrameStoppingRule>(*settings.error, frame.passes,
                                                              std::move(pixels));
    frame.frame_rule = rule.get();
    frame.rule = std::move(rule);
  } else {
    frame.rule =
        std::make_unique<contract::StoppingRule>(*settings.error, frame.passes, std::move(pixels));
  }
}

void FilmCache::close_frame(const FrameKey& key) {
  std::shared_ptr<Frame> frame;
  {
    const MutexLock lock(mutex_);
    const auto found = frames_.find(key);
    if (found == frames_.end()) return;
    frame = std::move(found->second);
    frames_.erase(found);
  }
  {
    const MutexLock lock(frame->mutex);
    frame->is_closed = true;
  }
  tiles_.drop(key);
}

bool FilmCache::is_open(const FrameKey& key) const {
  const MutexLock lock(mutex_);
  return frames_.contains(key);
}

std::vector<FrameKey> FilmCache::open_frames(const std::string& job_id) const {
  const MutexLock lock(mutex_);
  std::vector<FrameKey> keys;
  for (auto it = frames_.lower_bound({job_id, kFirstFrame}); it != frames_.end(); ++it) {
    if (it->first.job_id != job_id) break;
    keys.push_back(it->first);
  }
  return keys;
}

FilmCache::LockedFrame FilmCache::find(const FrameKey& key) const {
  std::shared_ptr<Frame> frame;
  {
    const MutexLock lock(mutex_);
    const auto found = frames_.find(key);
    if (found == frames_.end()) return {};
    frame = found->second;
  }
  std::unique_lock lock(frame->mutex);
  frame->mutex.assert_held();
  if (frame->is_closed) return {};
  return {std::move(frame), std::move(lock)};
}

absl::StatusOr<FilmCache::LockedFrame> FilmCache::find(const FrameKey& key, std::int32_t tile,
                                                       std::int32_t pass) const {
  LockedFrame frame = find(key);
  if (!frame) return absl::NotFoundError(absl::StrCat("film: ", label(key), " is not open"));
  if (tile < 0 || tile >= frame->grid.tile_count()) {
    return absl::InvalidArgumentError(absl::StrCat("film: ", label(key), " has no tile ", tile));
  }
  if (pass < 0 || contract::as_index(pass) >= frame->passes.size()) {
    return absl::InvalidArgumentError(absl::StrCat("film: ", label(key), " has no pass ", pass));
  }
  return frame;
}

/// Takes a tile out of the cache, or returns an empty one.
TileSum FilmCache::take(const Frame& frame, std::int32_t tile) {
  if (std::optional<TileSum> sum = tiles_.take(frame.key, tile)) return *std::move(sum);
  const contract::PixelRect rect = frame.grid.rect(tile);
  return {rect.width, rect.height, frame.aovs};
}

/// The same, but an empty one if a pass was not measured because m was unknown.
TileSum FilmCache::take_measured(const Frame& frame, std::int32_t tile) {
  TileSum sum = take(frame, tile);
  const auto begin = frame.tiles[contract::as_index(tile)].error.begin();
  const bool is_measured =
      !frame.mean_luminance || std::all_of(begin, begin + sum.pass_count(),
                                           [](const auto& error) { return error.has_value(); });
  if (is_measured) return sum;
  return {sum.size().width, sum.size().height, frame.aovs};
}

/// Passes that the tile gets, as far as is known.
std::int32_t FilmCache::pass_target(const Frame& frame, std::int32_t tile) {
  return frame.rule ? frame.rule->pass_count(tile) : pass_count(frame);
}

/// Adds the committed passes before `end` that the sums do not have. `block`, if not null, belongs
/// to pass end − 1; the others are read.
absl::Status FilmCache::advance(Frame& frame, std::int32_t tile, TileSum& sum,
                                const contract::FilmBlock* block, std::int32_t end) {
  const std::vector<bool>& committed = frame.tiles[contract::as_index(tile)].committed;
  absl::Status status;
  while (status.ok() && sum.pass_count() < end && sum.pass_count() < pass_target(frame, tile) &&
         committed[contract::as_index(sum.pass_count())]) {
    const std::int32_t pass = sum.pass_count();
    if (block != nullptr && pass == end - 1) {
      status = sum.add(*block, frame.passes[contract::as_index(pass)]);
    } else {
      const absl::StatusOr<contract::FilmBlock> read = frame.reader(tile, pass);
      status = read.ok() ? sum.add(*read, frame.passes[contract::as_index(pass)]) : read.status();
    }
    if (status.ok()) record_pass(frame, tile, sum);
  }
  return status;
}

/// Records the error of a tile after its latest pass, and adds it to the stopping rule. Requires m.
void FilmCache::measure(Frame& frame, std::int32_t tile, TileSum& sum) {
  const std::int32_t pass = sum.pass_count() - 1;
  Tile& state = frame.tiles[contract::as_index(tile)];
  std::optional<ErrorSums>& error = state.error[contract::as_index(pass)];
  if (!error) error = sum.measure(*frame.mean_luminance);
  if (frame.reference && !state.truth[contract::as_index(pass)]) {
    const auto reference = frame.reference(frame.grid.rect(tile));
    if (reference.ok()) {
      state.truth[contract::as_index(pass)] = sum.true_sums(*reference, *frame.mean_luminance);
    } else {
      frame.reference = {};
    }
  }
  if (frame.rule) frame.rule->add(tile, pass, *error);
}

/// Records what remains of a tile when its sums are evicted.
void FilmCache::record_pass(Frame& frame, std::int32_t index, TileSum& sum) {
  Tile& tile = frame.tiles[contract::as_index(index)];
  if (sum.pass_count() == 1 && !tile.luminance_sum) {
    tile.luminance_sum = sum.luminance_sum();
    --frame.tiles_without_luminance;
    if (frame.tiles_without_luminance == 0) {
      double total = 0;
      for (const Tile& each : frame.tiles) total += *each.luminance_sum;
      const contract::PixelRect& window = frame.grid.window();
      frame.mean_luminance = total / (static_cast<double>(window.width) * window.height);
      measure_cached(frame);
    }
  }
  if (frame.mean_luminance) measure(frame, index, sum);
}

/// Measures the cached tiles of a frame whose m has just become known.
void FilmCache::measure_cached(Frame& frame) {
  for (std::int32_t tile = 0; tile < frame.grid.tile_count(); ++tile) {
    std::optional<TileSum> sum = tiles_.take(frame.key, tile);
    if (!sum) continue;
    if (sum->pass_count() > 0) measure(frame, tile, *sum);
    tiles_.put(frame.key, tile, *std::move(sum));
  }
  frame.has_unread_blocks = true;  // tiles may have been evicted before being measured
}

absl::Status FilmCache::add(const FrameKey& key, std::int32_t tile, std::int32_t pass,
                            const contract::FilmBlock& block) {
  const absl::StatusOr<LockedFrame> found = find(key, tile, pass);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  frame.mutex.assert_held();
  const contract::PixelRect rect = frame.grid.rect(tile);
  if (block.shape != contract::FilmBlockShape{rect.width, rect.height, frame.aovs, pass == 0}) {
    return absl::InvalidArgumentError(absl::StrCat("film: ", label(key), ", tile ", tile, ", pass ",
                                                   pass, ": the block has another shape"));
  }
  std::vector<bool>& committed = frame.tiles[contract::as_index(tile)].committed;
  committed[contract::as_index(pass)] = true;
  // Ahead of its predecessors: read back once they are committed.
  if (std::find(committed.begin(), committed.begin() + pass, false) != committed.begin() + pass) {
    return absl::OkStatus();
  }
  TileSum sum = take(frame, tile);
  absl::Status status = advance(frame, tile, sum, &block, pass + 1);
  if (status.ok()) status = advance(frame, tile, sum, nullptr, pass_count(frame));
  if (sum.pass_count() <= pass) frame.has_unread_blocks = true;
  tiles_.put(key, tile, std::move(sum));
  return status;
}

absl::Status FilmCache::record_committed(const FrameKey& key, std::int32_t tile,
                                         std::int32_t pass) {
  const absl::StatusOr<LockedFrame> found = find(key, tile, pass);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  frame.mutex.assert_held();
  frame.tiles[contract::as_index(tile)].committed[contract::as_index(pass)] = true;
  frame.has_unread_blocks = true;
  return absl::OkStatus();
}

absl::StatusOr<double> FilmCache::mean_luminance(const FrameKey& key) {
  const absl::StatusOr<LockedFrame> found = find(key, 0, 0);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  frame.mutex.assert_held();
  if (absl::Status status = read_luminance(frame); !status.ok()) return status;
  return *frame.mean_luminance;
}

absl::Status FilmCache::read_luminance(Frame& frame) {
  for (std::int32_t tile = 0; !frame.mean_luminance; ++tile) {
    const Tile& state = frame.tiles[contract::as_index(tile)];
    if (state.luminance_sum) continue;
    if (!state.committed[0]) {
      return absl::FailedPreconditionError(
          absl::StrCat("film: ", label(frame.key), ": pass 0 of tile ", tile, " is missing"));
    }
    TileSum sum = take(frame, tile);
    absl::Status status = advance(frame, tile, sum, nullptr, 1);
    tiles_.put(frame.key, tile, std::move(sum));
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

/// Reads back committed blocks that the rule has not received: after a restart, or if m came late.
absl::Status FilmCache::catch_up(Frame& frame) {
  bool has_read = true;
  while (has_read) {  // a new target may cover passes that are already committed
    has_read = frame.has_unread_blocks = false;
    for (std::int32_t tile = 0; tile < frame.grid.tile_count(); ++tile) {
      const Tile& state = frame.tiles[contract::as_index(tile)];
      const auto next = contract::as_index(frame.rule->pass_count(tile));
      const auto first = std::find(state.error.begin(), state.error.end(), std::nullopt);
      const auto unmeasured = static_cast<std::size_t>(first - state.error.begin());
      if (unmeasured < next && state.committed[unmeasured]) {
        TileSum sum = take_measured(frame, tile);
        absl::Status status = advance(frame, tile, sum, nullptr, pass_count(frame));
        tiles_.put(frame.key, tile, std::move(sum));
        if (!status.ok()) return status;
        has_read = true;
      } else if (next < state.committed.size() && state.committed[next]) {
        frame.has_unread_blocks = true;  // its target is still pending
      }
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<contract::PassRule::PassTarget>> FilmCache::take_pass_targets(
    const FrameKey& key) {
  const absl::StatusOr<LockedFrame> found = find(key, 0, 0);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  frame.mutex.assert_held();
  if (!frame.rule) return std::vector<contract::PassRule::PassTarget>();
  if (!frame.mean_luminance) {
    const absl::Status status = read_luminance(frame);
    if (absl::IsFailedPrecondition(status)) return std::vector<contract::PassRule::PassTarget>();
    if (!status.ok()) return status;
  }
  if (frame.has_unread_blocks) {
    if (absl::Status status = catch_up(frame); !status.ok()) return status;
  }
  return frame.rule->take_changes();
}

absl::StatusOr<TileSum> FilmCache::rebuild(const FrameKey& key, std::int32_t tile, bool keep) {
  const absl::StatusOr<LockedFrame> found = find(key, tile, 0);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  frame.mutex.assert_held();
  TileSum sum = take_measured(frame, tile);
  absl::Status status = advance(frame, tile, sum, nullptr, pass_count(frame));
  if (keep) tiles_.put(key, tile, sum);
  if (!status.ok()) return status;
  return sum;
}

absl::StatusOr<TileSum> FilmCache::tile(const FrameKey& key, std::int32_t tile) {
  return rebuild(key, tile, true);
}

absl::StatusOr<TileSum> FilmCache::take_tile(const FrameKey& key, std::int32_t tile) {
  return rebuild(key, tile, false);
}

ErrorEstimate FilmCache::running_estimate(const FrameKey& key) const {
  const LockedFrame frame = find(key);
  if (!frame) return {};
  frame->mutex.assert_held();
  return stats_after(*frame, pass_count(*frame) - 1).estimate;
}

FilmCache::PassStats FilmCache::after_pass(const FrameKey& key, std::int32_t pass) const {
  const LockedFrame frame = find(key);
  if (!frame || pass < 0 || pass >= pass_count(*frame)) return {};
  frame->mutex.assert_held();
  return stats_after(*frame, pass);
}

FilmCache::PassStats FilmCache::stats_after(const Frame& frame, std::int32_t pass) {
  ErrorSums sums;
  PassStats figures;
  bool is_truth_known = frame.reference != nullptr;
  TrueSums truth;
  for (const Tile& tile : frame.tiles) {
    std::int32_t newest = pass;
    while (newest >= 0 && !tile.error[contract::as_index(newest)]) --newest;
    is_truth_known = is_truth_known && newest >= 0 && tile.truth[contract::as_index(newest)];
    if (is_truth_known) truth.add(*tile.truth[contract::as_index(newest)]);
    if (newest < 0) continue;
    const ErrorSums& error = *tile.error[contract::as_index(newest)];
    const contract::Pass& last = frame.passes[contract::as_index(newest)];
    figures.samples += error.pixels * last.end();
    sums.add(error);
  }
  figures.estimate = contract::estimate_error(sums, frame.rule ? frame.rule->looks() : 1);
  if (is_truth_known) {
    figures.truth = figures_of(truth, sums.pixels, frame.mean_luminance.value_or(0) > 0);
  }
  return figures;
}

bool FilmCache::is_look_due(const FrameKey& key) const {
  const LockedFrame frame = find(key);
  if (!frame) return false;
  frame->mutex.assert_held();
  return frame->frame_rule != nullptr && frame->frame_rule->due_look().has_value();
}

void FilmCache::end_look(const FrameKey& key,
                         const contract::FrameStoppingRule::LookResult& result) {
  const LockedFrame frame = find(key);
  if (!frame) return;
  frame->mutex.assert_held();
  if (frame->frame_rule != nullptr) frame->frame_rule->end_look(result);
}

StoppingStats FilmCache::stopping(const FrameKey& key) const {
  const LockedFrame frame = find(key);
  if (!frame) return {};
  frame->mutex.assert_held();
  if (!frame->rule) return {};
  const contract::PassRule& rule = *frame->rule;
  return {rule.looks(), rule.capped_tile_count(), rule.is_futile()};
}

std::int32_t FilmCache::max_samples(const FrameKey& key) const {
  const LockedFrame frame = find(key);
  if (!frame) return 0;
  frame->mutex.assert_held();
  std::int32_t samples = 0;
  for (std::size_t tile = 0; tile < frame->tiles.size(); ++tile) {
    const std::vector<bool>& committed = frame->tiles[tile].committed;
    const std::int32_t wanted = pass_target(*frame, static_cast<std::int32_t>(tile));
    for (std::int32_t pass = 0; pass < wanted && committed[contract::as_index(pass)]; ++pass) {
      samples = std::max(samples, frame->passes[contract::as_index(pass)].end());
    }
  }
  return samples;
}

std::optional<std::int64_t> FilmCache::expected_samples(const FrameKey& key) const {
  const LockedFrame frame = find(key);
  if (!frame) return std::nullopt;
  frame->mutex.assert_held();
  if (!frame->rule) return std::nullopt;
  return frame->rule->expected_samples();
}

}  // namespace tessera::server
