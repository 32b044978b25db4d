#include "server/film/film_cache.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "contract/index.h"
#include "contract/stopping/stopping_rule.h"

namespace tessera::server {
namespace {

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

FilmCache::FilmCache(std::int64_t budget_bytes) : budget_bytes_(budget_bytes) {}

void FilmCache::open_frame(const FrameKey& key, const contract::RenderSettings& settings,
                           BlockReader reader, ReferenceReader reference) {
  const std::lock_guard lock(mutex_);
  contract::TileGrid grid(settings);
  std::vector<contract::Pass> passes = contract::schedule(settings);
  const std::int32_t tile_count = grid.tile_count();
  Tile tile;
  tile.committed.resize(passes.size());
  tile.error.resize(passes.size());
  if (reference) tile.truth.resize(passes.size());
  Frame frame{std::move(grid),
              settings.aovs,
              std::move(passes),
              std::move(reader),
              std::move(reference),
              std::vector<Tile>(contract::as_index(tile_count), tile),
              tile_count};
  if (settings.error) add_rule(settings, frame);
  frames_.emplace(key, std::move(frame));
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
  const std::lock_guard lock(mutex_);
  for (auto it = index_.lower_bound({key, 0}); it != index_.end() && it->first.first == key;) {
    const auto entry = it->second;
    ++it;
    drop_entry(entry);
  }
  frames_.erase(key);
}

bool FilmCache::is_open(const FrameKey& key) const {
  const std::lock_guard lock(mutex_);
  return frames_.contains(key);
}

absl::StatusOr<FilmCache::Frame*> FilmCache::find(const FrameKey& key, std::int32_t tile,
                                                  std::int32_t pass) {
  const auto found = frames_.find(key);
  if (found == frames_.end()) {
    return absl::NotFoundError(absl::StrCat("film: ", label(key), " is not open"));
  }
  Frame& frame = found->second;
  if (tile < 0 || tile >= frame.grid.tile_count()) {
    return absl::InvalidArgumentError(absl::StrCat("film: ", label(key), " has no tile ", tile));
  }
  if (pass < 0 || contract::as_index(pass) >= frame.passes.size()) {
    return absl::InvalidArgumentError(absl::StrCat("film: ", label(key), " has no pass ", pass));
  }
  return &frame;
}

FilmCache::Entry& FilmCache::fetch_entry(const FrameKey& key, Frame& frame, std::int32_t tile) {
  if (const auto found = index_.find({key, tile}); found != index_.end()) {
    entries_.splice(entries_.begin(), entries_, found->second);
    return entries_.front();
  }
  const contract::PixelRect rect = frame.grid.rect(tile);
  entries_.push_front({{key, tile}, TileSum(rect.width, rect.height, frame.aovs)});
  index_[{key, tile}] = entries_.begin();
  used_bytes_ += entries_.front().sum.bytes();
  return entries_.front();
}

/// Passes that the tile gets, as far as is known.
std::int32_t FilmCache::pass_target(const Frame& frame, std::int32_t tile) {
  return frame.rule ? frame.rule->pass_count(tile) : pass_count(frame);
}

/// Adds the committed passes before `end` that the entry does not have. `block`, if not null,
/// belongs to pass end − 1; the others are read.
absl::Status FilmCache::advance(Frame& frame, Entry& entry, const contract::FilmBlock* block,
                                std::int32_t end) {
  const Tile& tile = frame.tiles[contract::as_index(entry.key.second)];
  const std::int64_t bytes_before = entry.sum.bytes();
  absl::Status status;
  while (status.ok() && entry.sum.pass_count() < end &&
         entry.sum.pass_count() < pass_target(frame, entry.key.second) &&
         tile.committed[contract::as_index(entry.sum.pass_count())]) {
    const std::int32_t pass = entry.sum.pass_count();
    if (block != nullptr && pass == end - 1) {
      status = entry.sum.add(*block, frame.passes[contract::as_index(pass)]);
    } else {
      const absl::StatusOr<contract::FilmBlock> read = frame.reader(entry.key.second, pass);
      status =
          read.ok() ? entry.sum.add(*read, frame.passes[contract::as_index(pass)]) : read.status();
    }
    if (status.ok()) record_pass(frame, entry);
  }
  used_bytes_ += entry.sum.bytes() - bytes_before;
  return status;
}

/// Records the error of a tile after its latest pass, and adds it to the stopping rule. Requires m.
void FilmCache::measure(Frame& frame, std::int32_t tile, const TileSum& sum) {
  const std::int32_t pass = sum.pass_count() - 1;
  Tile& state = frame.tiles[contract::as_index(tile)];
  std::optional<ErrorSums>& error = state.error[contract::as_index(pass)];
  if (!error) error = sum.error_sums(*frame.mean_luminance);
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
void FilmCache::record_pass(Frame& frame, const Entry& entry) {
  Tile& tile = frame.tiles[contract::as_index(entry.key.second)];
  const std::int32_t pass = entry.sum.pass_count() - 1;
  if (pass == 0 && !tile.luminance_sum) {
    tile.luminance_sum = entry.sum.luminance_sum();
    --frame.tiles_without_luminance;
    if (frame.tiles_without_luminance == 0) {
      double sum = 0;
      for (const Tile& each : frame.tiles) sum += *each.luminance_sum;
      const contract::PixelRect& window = frame.grid.window();
      frame.mean_luminance = sum / (static_cast<double>(window.width) * window.height);
      measure_cached(entry.key.first, frame);
    }
  }
  if (frame.mean_luminance) measure(frame, entry.key.second, entry.sum);
}

/// Measures the cached tiles of a frame whose m has just become known.
void FilmCache::measure_cached(const FrameKey& key, Frame& frame) {
  for (auto it = index_.lower_bound({key, 0}); it != index_.end() && it->first.first == key; ++it) {
    const TileSum& sum = it->second->sum;
    if (sum.pass_count() > 0) measure(frame, it->first.second, sum);
  }
  frame.has_unread_blocks = true;  // tiles may have been evicted before being measured
}

void FilmCache::drop_entry(Entries::iterator entry) {
  used_bytes_ -= entry->sum.bytes();
  index_.erase(entry->key);
  entries_.erase(entry);
}

void FilmCache::evict(const Entry* keep) {
  while (used_bytes_ > budget_bytes_ && !entries_.empty() && &entries_.back() != keep) {
    drop_entry(std::prev(entries_.end()));
  }
}

absl::Status FilmCache::add(const FrameKey& key, std::int32_t tile, std::int32_t pass,
                            const contract::FilmBlock& block) {
  const std::lock_guard lock(mutex_);
  const absl::StatusOr<Frame*> found = find(key, tile, pass);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
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
  Entry& entry = fetch_entry(key, frame, tile);
  absl::Status status = advance(frame, entry, &block, pass + 1);
  if (status.ok()) status = advance(frame, entry, nullptr, pass_count(frame));
  if (entry.sum.pass_count() <= pass) frame.has_unread_blocks = true;
  evict(&entry);
  return status;
}

absl::Status FilmCache::record_committed(const FrameKey& key, std::int32_t tile,
                                         std::int32_t pass) {
  const std::lock_guard lock(mutex_);
  const absl::StatusOr<Frame*> found = find(key, tile, pass);
  if (!found.ok()) return found.status();
  (*found)->tiles[contract::as_index(tile)].committed[contract::as_index(pass)] = true;
  (*found)->has_unread_blocks = true;
  return absl::OkStatus();
}

absl::StatusOr<double> FilmCache::mean_luminance(const FrameKey& key) {
  const std::lock_guard lock(mutex_);
  const absl::StatusOr<Frame*> found = find(key, 0, 0);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  if (absl::Status status = read_luminance(key, frame); !status.ok()) return status;
  return *frame.mean_luminance;
}

absl::Status FilmCache::read_luminance(const FrameKey& key, Frame& frame) {
  for (std::int32_t tile = 0; !frame.mean_luminance; ++tile) {
    const Tile& state = frame.tiles[contract::as_index(tile)];
    if (state.luminance_sum) continue;
    if (!state.committed[0]) {
      return absl::FailedPreconditionError(
          absl::StrCat("film: ", label(key), ": pass 0 of tile ", tile, " is missing"));
    }
    Entry& entry = fetch_entry(key, frame, tile);
    absl::Status status = advance(frame, entry, nullptr, 1);
    evict(&entry);
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

/// Reads back committed blocks that the rule has not received: after a restart, or if m came late.
absl::Status FilmCache::catch_up(const FrameKey& key, Frame& frame) {
  bool has_read = true;
  while (has_read) {  // a new target may cover passes that are already committed
    has_read = frame.has_unread_blocks = false;
    for (std::int32_t tile = 0; tile < frame.grid.tile_count(); ++tile) {
      const Tile& state = frame.tiles[contract::as_index(tile)];
      const auto next = contract::as_index(frame.rule->pass_count(tile));
      const auto first = std::find(state.error.begin(), state.error.end(), std::nullopt);
      const auto unmeasured = static_cast<std::size_t>(first - state.error.begin());
      if (unmeasured < next && state.committed[unmeasured]) {
        if (!is_measured(frame, key, tile)) drop_entry(index_.at({key, tile}));
        Entry& entry = fetch_entry(key, frame, tile);
        absl::Status status = advance(frame, entry, nullptr, pass_count(frame));
        evict(&entry);
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
  const std::lock_guard lock(mutex_);
  const absl::StatusOr<Frame*> found = find(key, 0, 0);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  if (!frame.rule) return std::vector<contract::PassRule::PassTarget>();
  if (!frame.mean_luminance) {
    const absl::Status status = read_luminance(key, frame);
    if (absl::IsFailedPrecondition(status)) return std::vector<contract::PassRule::PassTarget>();
    if (!status.ok()) return status;
  }
  if (frame.has_unread_blocks) {
    if (absl::Status status = catch_up(key, frame); !status.ok()) return status;
  }
  return frame.rule->take_changes();
}

/// Returns false if the tile is cached and a pass was not measured because m was unknown.
bool FilmCache::is_measured(const Frame& frame, const FrameKey& key, std::int32_t tile) const {
  const auto found = index_.find({key, tile});
  if (found == index_.end() || !frame.mean_luminance) return true;
  const auto begin = frame.tiles[contract::as_index(tile)].error.begin();
  return std::all_of(begin, begin + found->second->sum.pass_count(),
                     [](const auto& error) { return error.has_value(); });
}

absl::StatusOr<TileSum> FilmCache::rebuild(const FrameKey& key, std::int32_t tile, bool keep) {
  const std::lock_guard lock(mutex_);
  const absl::StatusOr<Frame*> found = find(key, tile, 0);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  if (!is_measured(frame, key, tile)) drop_entry(index_.at({key, tile}));
  Entry& entry = fetch_entry(key, frame, tile);
  absl::Status status = advance(frame, entry, nullptr, pass_count(frame));
  if (!status.ok()) return status;
  if (keep) {
    TileSum copy = entry.sum;
    evict(&entry);
    return copy;
  }
  used_bytes_ -= entry.sum.bytes();
  TileSum sum = std::move(entry.sum);
  const auto position = index_.find({key, tile});
  entries_.erase(position->second);
  index_.erase(position);
  return sum;
}

absl::StatusOr<TileSum> FilmCache::tile(const FrameKey& key, std::int32_t tile) {
  return rebuild(key, tile, true);
}

absl::StatusOr<TileSum> FilmCache::take_tile(const FrameKey& key, std::int32_t tile) {
  return rebuild(key, tile, false);
}

ErrorEstimate FilmCache::running_estimate(const FrameKey& key) const {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  if (found == frames_.end()) return {};
  return stats_after(found->second, pass_count(found->second) - 1).estimate;
}

FilmCache::PassStats FilmCache::after_pass(const FrameKey& key, std::int32_t pass) const {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  if (found == frames_.end() || pass < 0 || pass >= pass_count(found->second)) return {};
  return stats_after(found->second, pass);
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
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  return found != frames_.end() && found->second.frame_rule != nullptr &&
         found->second.frame_rule->due_look().has_value();
}

void FilmCache::end_look(const FrameKey& key,
                         const contract::FrameStoppingRule::LookResult& result) {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  if (found == frames_.end() || found->second.frame_rule == nullptr) return;
  found->second.frame_rule->end_look(result);
}

StoppingStats FilmCache::stopping(const FrameKey& key) const {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  if (found == frames_.end() || !found->second.rule) return {};
  const contract::PassRule& rule = *found->second.rule;
  return {rule.looks(), rule.capped_tile_count(), rule.is_futile()};
}

std::int32_t FilmCache::max_samples(const FrameKey& key) const {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  if (found == frames_.end()) return 0;
  const Frame& frame = found->second;
  std::int32_t samples = 0;
  for (std::size_t tile = 0; tile < frame.tiles.size(); ++tile) {
    const std::vector<bool>& committed = frame.tiles[tile].committed;
    const std::int32_t wanted = pass_target(frame, static_cast<std::int32_t>(tile));
    for (std::int32_t pass = 0; pass < wanted && committed[contract::as_index(pass)]; ++pass) {
      samples = std::max(samples, frame.passes[contract::as_index(pass)].end());
    }
  }
  return samples;
}

std::optional<std::int64_t> FilmCache::expected_samples(const FrameKey& key) const {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  if (found == frames_.end() || !found->second.rule) return std::nullopt;
  return found->second.rule->expected_samples();
}

std::int64_t FilmCache::used_bytes() const {
  const std::lock_guard lock(mutex_);
  return used_bytes_;
}

}  // namespace tessera::server
