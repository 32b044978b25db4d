#include "server/film/film_cache.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

std::size_t at(std::int32_t index) {
  return static_cast<std::size_t>(index);
}

template <typename Frame>
std::int32_t pass_count(const Frame& frame) {
  return static_cast<std::int32_t>(frame.passes.size());
}

std::string label(const FrameKey& key) {
  return absl::StrCat("job ", key.job_id, ", frame ", key.frame);
}

}  // namespace

FilmCache::FilmCache(std::int64_t budget_bytes) : budget_bytes_(budget_bytes) {}

void FilmCache::open_frame(const FrameKey& key, const contract::RenderSettings& settings,
                           std::vector<contract::Pass> passes, BlockReader reader) {
  const std::lock_guard lock(mutex_);
  contract::TileGrid grid(settings);
  const std::int32_t tile_count = grid.tile_count();
  Tile tile;
  tile.committed.resize(passes.size());
  tile.error.resize(passes.size());
  Frame frame{std::move(grid),
              settings.aovs,
              std::move(passes),
              std::move(reader),
              std::vector<Tile>(at(tile_count), tile),
              tile_count,
              std::nullopt};
  frames_.emplace(key, std::move(frame));
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
  if (pass < 0 || at(pass) >= frame.passes.size()) {
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

/// Adds the committed passes before `end` that follow on those the entry has. `block`, if not
/// null, is the one of pass end − 1; the others are read.
absl::Status FilmCache::advance(Frame& frame, Entry& entry, const contract::FilmBlock* block,
                                std::int32_t end) {
  const Tile& tile = frame.tiles[at(entry.key.second)];
  const std::int64_t bytes_before = entry.sum.bytes();
  absl::Status status;
  while (status.ok() && entry.sum.pass_count() < end &&
         tile.committed[at(entry.sum.pass_count())]) {
    const std::int32_t pass = entry.sum.pass_count();
    if (block != nullptr && pass == end - 1) {
      status = entry.sum.add(*block, frame.passes[at(pass)]);
    } else {
      const absl::StatusOr<contract::FilmBlock> read = frame.reader(entry.key.second, pass);
      status = read.ok() ? entry.sum.add(*read, frame.passes[at(pass)]) : read.status();
    }
    if (status.ok()) after_pass(frame, entry);
  }
  used_bytes_ += entry.sum.bytes() - bytes_before;
  return status;
}

/// Notes what is kept of a tile when its sums are gone.
void FilmCache::after_pass(Frame& frame, const Entry& entry) {
  Tile& tile = frame.tiles[at(entry.key.second)];
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
  std::optional<ErrorSums>& error = tile.error[at(pass)];
  if (frame.mean_luminance && !error) error = entry.sum.error_sums(*frame.mean_luminance);
}

/// Measures the cached tiles of a frame whose m has just become known.
void FilmCache::measure_cached(const FrameKey& key, Frame& frame) {
  for (auto it = index_.lower_bound({key, 0}); it != index_.end() && it->first.first == key; ++it) {
    const TileSum& sum = it->second->sum;
    if (sum.pass_count() == 0) continue;
    std::optional<ErrorSums>& error =
        frame.tiles[at(it->first.second)].error[at(sum.pass_count() - 1)];
    if (!error) error = sum.error_sums(*frame.mean_luminance);
  }
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
  std::vector<bool>& committed = frame.tiles[at(tile)].committed;
  committed[at(pass)] = true;
  // Ahead of its turn: it will be read back when the passes before it are there.
  if (std::find(committed.begin(), committed.begin() + pass, false) != committed.begin() + pass) {
    return absl::OkStatus();
  }
  Entry& entry = fetch_entry(key, frame, tile);
  absl::Status status = advance(frame, entry, &block, pass + 1);
  if (status.ok()) status = advance(frame, entry, nullptr, pass_count(frame));
  evict(&entry);
  return status;
}

absl::Status FilmCache::note_committed(const FrameKey& key, std::int32_t tile, std::int32_t pass) {
  const std::lock_guard lock(mutex_);
  const absl::StatusOr<Frame*> found = find(key, tile, pass);
  if (!found.ok()) return found.status();
  (*found)->tiles[at(tile)].committed[at(pass)] = true;
  return absl::OkStatus();
}

absl::StatusOr<double> FilmCache::mean_luminance(const FrameKey& key) {
  const std::lock_guard lock(mutex_);
  const absl::StatusOr<Frame*> found = find(key, 0, 0);
  if (!found.ok()) return found.status();
  Frame& frame = **found;
  for (std::int32_t tile = 0; !frame.mean_luminance; ++tile) {
    const Tile& state = frame.tiles[at(tile)];
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
  return *frame.mean_luminance;
}

/// False if the tile is cached and passed one without being measured, as m was not known yet.
bool FilmCache::is_measured(const Frame& frame, const FrameKey& key, std::int32_t tile) const {
  const auto found = index_.find({key, tile});
  if (found == index_.end() || !frame.mean_luminance) return true;
  const auto begin = frame.tiles[at(tile)].error.begin();
  return std::all_of(begin, begin + found->second->sum.pass_count(),
                     [](const auto& error) { return error.has_value(); });
}

absl::StatusOr<TileSum> FilmCache::rebuilt(const FrameKey& key, std::int32_t tile, bool keep) {
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
  return rebuilt(key, tile, true);
}

absl::StatusOr<TileSum> FilmCache::take_tile(const FrameKey& key, std::int32_t tile) {
  return rebuilt(key, tile, false);
}

ErrorEstimate FilmCache::running_estimate(const FrameKey& key) const {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  ErrorSums sums;
  if (found == frames_.end()) return estimate_error(sums);
  for (const Tile& tile : found->second.tiles) {
    const auto newest = std::find_if(tile.error.rbegin(), tile.error.rend(),
                                     [](const auto& error) { return error.has_value(); });
    if (newest != tile.error.rend()) sums.add(**newest);
  }
  return estimate_error(sums);
}

ErrorEstimate FilmCache::estimate_after_pass(const FrameKey& key, std::int32_t pass) const {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(key);
  ErrorSums sums;
  if (found == frames_.end() || pass < 0 || at(pass) >= found->second.passes.size()) {
    return estimate_error(sums);
  }
  for (const Tile& tile : found->second.tiles) {
    if (tile.error[at(pass)]) sums.add(*tile.error[at(pass)]);
  }
  return estimate_error(sums);
}

std::int64_t FilmCache::used_bytes() const {
  const std::lock_guard lock(mutex_);
  return used_bytes_;
}

}  // namespace tessera::server
