#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "contract/film_block.h"
#include "contract/render_settings.h"
#include "contract/stopping_rule.h"
#include "contract/tile_grid.h"
#include "server/film/convergence.h"
#include "server/film/merge.h"

namespace tessera::server {

/// One frame of one job.
struct FrameKey {
  std::string job_id;
  std::int32_t frame = 0;
  auto operator<=>(const FrameKey&) const = default;
};

/// Reads a committed block back: (tile, pass) of the frame it was made for.
using BlockReader =
    std::function<absl::StatusOr<contract::FilmBlock>(std::int32_t tile, std::int32_t pass)>;

/// Pixels of the frame's reference image: R, G, B, A of each in the rectangle, row by row.
using ReferenceReader =
    std::function<absl::StatusOr<std::vector<float>>(const contract::PixelRect& rect)>;

/// The film of all open frames: sums per tile as a cache over the committed blocks, which are the
/// only truth. Memory stays at the budget (least recently used tiles go first, and are rebuilt
/// through the frame's BlockReader); per tile it keeps the passes' error sums, 48 bytes each.
///
/// Thread-safe: one lock of its own around every call. A call may read blocks under it, so do not
/// call with the coordinator's lock held, and a BlockReader must not call back into the cache.
class FilmCache {
 public:
  /// `budget_bytes`: --film-memory-gb. One tile is held however small it is.
  explicit FilmCache(std::int64_t budget_bytes);

  /// Begins a frame. Requires that it is not open. With a `reference` the true error is kept too,
  /// for as long as it can be read.
  void open_frame(const FrameKey& key, const contract::RenderSettings& settings, BlockReader reader,
                  ReferenceReader reference = {});
  /// Forgets a frame (finished or cancelled). Harmless if it is not open.
  void close_frame(const FrameKey& key);
  bool is_open(const FrameKey& key) const;

  /// Tells of a durably committed block. In any order; repeats are harmless. A block ahead of
  /// its tile's passes is only noted, and read back once its turn comes.
  ///
  /// Errors: NotFound, the frame is not open; InvalidArgument, no such tile or pass, or the block
  /// has another shape; whatever the BlockReader gives.
  absl::Status add(const FrameKey& key, std::int32_t tile, std::int32_t pass,
                   const contract::FilmBlock& block);
  /// The same after a restart, for a unit of the journal, without reading anything yet.
  absl::Status record_committed(const FrameKey& key, std::int32_t tile, std::int32_t pass);

  /// m: mean luminance of the frame after pass 0 of every tile, folded in tile order. Reads
  /// blocks of pass 0 that this process has not seen.
  ///
  /// Errors: NotFound; FailedPrecondition, pass 0 of a tile is missing; the BlockReader's.
  absl::StatusOr<double> mean_luminance(const FrameKey& key);

  /// In a job asked for by its error: how many passes tiles are to have, as decided since the last
  /// call; empty for others. Reads what has to be read for it. Errors: as mean_luminance's, but
  /// not that pass 0 is incomplete.
  absl::StatusOr<std::vector<contract::StoppingRule::PassTarget>> take_pass_targets(
      const FrameKey& key);
  /// How the frame's tiles stopped; looks is 1 and the rest 0 with a fixed sample count.
  StoppingStats stopping(const FrameKey& key) const;
  /// Samples of the pixels that have most; 0 before the first block, and if it is not open.
  std::int32_t max_samples(const FrameKey& key) const;
  /// Samples of the frame, done and foreseen; nullopt if it is not open or the count is fixed.
  std::optional<std::int64_t> expected_samples(const FrameKey& key) const;

  /// The sums of a tile over its committed passes 0, 1, … up to the first gap, or to what it was
  /// decided to have; rebuilt if needed, also when it was not measured after each pass because m
  /// came later. pass_count() is 0 if pass 0 is missing. `tile` leaves it in the cache,
  /// `take_tile` removes it.
  absl::StatusOr<TileSum> tile(const FrameKey& key, std::int32_t tile);
  absl::StatusOr<TileSum> take_tile(const FrameKey& key, std::int32_t tile);

  /// Estimated error of the frame so far, for progress: over the tiles measured, each at its
  /// newest pass. pixels is 0 before pass 0 of every tile is there. Cheap: reads no blocks.
  ErrorEstimate running_estimate(const FrameKey& key) const;
  /// The frame had it ended after `pass`: the points of the report's curve. Tiles that have fewer
  /// passes count with what they have. Covers every tile once each has been asked for with m known.
  struct PassStats {
    ErrorEstimate estimate;
    std::int64_t samples = 0;
    std::optional<TrueErrorStats> truth;  // with a reference, once every tile is measured
  };
  PassStats after_pass(const FrameKey& key, std::int32_t pass) const;

  /// Memory of the cached sums.
  std::int64_t used_bytes() const;

 private:
  struct Tile {
    std::vector<bool> committed;                  // by pass
    std::optional<double> luminance_sum;          // after pass 0
    std::vector<std::optional<ErrorSums>> error;  // after each pass, once m is known
    std::vector<std::optional<TrueSums>> truth;   // the same, with a reference
  };
  struct Frame {
    contract::TileGrid grid;
    std::uint32_t aovs;
    std::vector<contract::Pass> passes;
    BlockReader reader;
    ReferenceReader reference;  // empty: none
    std::vector<Tile> tiles;
    std::int32_t tiles_without_luminance;
    std::optional<double> mean_luminance;
    std::optional<contract::StoppingRule> rule;  // of a job asked for by its error
    bool has_unread_blocks = false;  // blocks may be committed that the rule has not heard of
  };
  using TileKey = std::pair<FrameKey, std::int32_t>;
  struct Entry {
    TileKey key;
    TileSum sum;
  };
  using Entries = std::list<Entry>;  // most recently used first

  absl::StatusOr<Frame*> find(const FrameKey& key, std::int32_t tile, std::int32_t pass);
  Entry& fetch_entry(const FrameKey& key, Frame& frame, std::int32_t tile);
  absl::Status advance(Frame& frame, Entry& entry, const contract::FilmBlock* block,
                       std::int32_t end);
  bool is_measured(const Frame& frame, const FrameKey& key, std::int32_t tile) const;
  absl::Status read_luminance(const FrameKey& key, Frame& frame);
  absl::Status catch_up(const FrameKey& key, Frame& frame);
  static PassStats stats_after(const Frame& frame, std::int32_t pass);
  static std::int32_t pass_target(const Frame& frame, std::int32_t tile);
  static void measure(Frame& frame, std::int32_t tile, const TileSum& sum);
  void note_pass(Frame& frame, const Entry& entry);
  void measure_cached(const FrameKey& key, Frame& frame);
  absl::StatusOr<TileSum> rebuild(const FrameKey& key, std::int32_t tile, bool keep);
  void drop_entry(Entries::iterator entry);
  void evict(const Entry* keep);

  mutable std::mutex mutex_;
  const std::int64_t budget_bytes_;
  std::int64_t used_bytes_ = 0;
  std::map<FrameKey, Frame> frames_;
  Entries entries_;
  std::map<TileKey, Entries::iterator> index_;
};

}  // namespace tessera::server
