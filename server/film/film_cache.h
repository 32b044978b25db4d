#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "contract/film_block.h"
#include "contract/render_settings.h"
#include "contract/stopping/frame_stopping_rule.h"
#include "contract/stopping/pass_rule.h"
#include "contract/tile_grid.h"
#include "server/film/convergence.h"
#include "server/film/frame_key.h"
#include "server/film/merge.h"
#include "server/film/tile_cache.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Reads a committed block: (tile, pass) of the frame that it was created for.
using BlockReader =
    std::function<absl::StatusOr<contract::FilmBlock>(std::int32_t tile, std::int32_t pass)>;

/// Reads pixels of the frame's reference image: R, G, B, A of each in the rectangle, row-major.
using ReferenceReader =
    std::function<absl::StatusOr<std::vector<float>>(const contract::PixelRect& rect)>;

/// Film of all open frames: sums per tile, a cache over the committed blocks, which are
/// authoritative. Memory stays within the budget: least recently used tiles are evicted, and
/// rebuilt with the frame's BlockReader. In addition each tile keeps the error sums of its passes,
/// 48 bytes each.
///
/// Thread-safe: each frame has a lock, so calls about different frames run at the same time. A call
/// may read blocks under it, so call only open_frames() and used_bytes() with the coordinator's
/// lock held; a BlockReader must not call back into the cache.
class FilmCache {
 public:
  /// `budget_bytes` is --film-memory-gb. At least one tile is kept whatever the budget.
  explicit FilmCache(std::int64_t budget_bytes) : tiles_(budget_bytes) {}

  /// Opens a frame, which must not be open. With a `reference` the true error is computed too, as
  /// long as the reference can be read.
  void open_frame(const FrameKey& key, const contract::RenderSettings& settings, BlockReader reader,
                  ReferenceReader reference = {});
  /// Drops a frame (finished or cancelled). Harmless if it is not open.
  void close_frame(const FrameKey& key);
  bool is_open(const FrameKey& key) const;
  /// Returns the open frames of a job.
  std::vector<FrameKey> open_frames(const std::string& job_id) const;

  /// Adds a committed block in any order; duplicates are ignored. A block ahead of its predecessors
  /// is recorded and read back later.
  ///
  /// Errors: NotFound, the frame is not open; InvalidArgument, no such tile or pass, or the block
  /// has another shape; the BlockReader's.
  absl::Status add(const FrameKey& key, std::int32_t tile, std::int32_t pass,
                   const contract::FilmBlock& block);
  /// Records a unit of the journal after a restart, without reading its block yet. Errors: as
  /// add().
  absl::Status record_committed(const FrameKey& key, std::int32_t tile, std::int32_t pass);

  /// Returns m, the mean luminance of the frame after pass 0 of every tile, folded in tile order.
  /// Reads blocks of pass 0 that this process has not seen.
  ///
  /// Errors: NotFound; FailedPrecondition, pass 0 of a tile is missing; the BlockReader's.
  absl::StatusOr<double> mean_luminance(const FrameKey& key);

  /// With a target error: returns the pass targets that changed since the last call; empty for
  /// other jobs. Reads blocks as needed. Errors: as mean_luminance(), except for an incomplete pass
  /// 0.
  absl::StatusOr<std::vector<contract::PassRule::PassTarget>> take_pass_targets(
      const FrameKey& key);
  /// Whether the frame must be denoised before take_pass_targets() has more targets. tile() then
  /// returns the sums to be denoised.
  bool is_look_due(const FrameKey& key) const;
  /// Reports the error and bound of the denoised frame. Ignored if no look is due.
  void end_look(const FrameKey& key, const contract::FrameStoppingRule::LookResult& result);
  /// Returns how the frame's tiles stopped; with a fixed sample count looks is 1 and the rest 0.
  StoppingStats stopping(const FrameKey& key) const;
  /// Maximum number of samples per pixel; 0 before the first block or if the frame is not open.
  std::int32_t max_samples(const FrameKey& key) const;
  /// Samples of the frame, done and predicted; nullopt if it is not open or has a fixed sample
  /// count.
  std::optional<std::int64_t> expected_samples(const FrameKey& key) const;

  /// Returns the sums of a tile over its committed passes 0, 1, … up to the first gap or the pass
  /// target; rebuilt if necessary, also if a pass was not measured because m came later.
  /// pass_count() is 0 if pass 0 is missing. tile() leaves the sums in the cache, take_tile()
  /// removes them.
  absl::StatusOr<TileSum> tile(const FrameKey& key, std::int32_t tile);
  absl::StatusOr<TileSum> take_tile(const FrameKey& key, std::int32_t tile);

  /// Returns the estimated error of the frame so far, for progress: over the measured tiles, each
  /// at its latest pass. pixels is 0 until pass 0 of every tile is committed. Cheap: reads no
  /// blocks.
  ErrorEstimate running_estimate(const FrameKey& key) const;
  /// Frame statistics as if rendering had ended after `pass`; one point of the report's curve.
  /// Tiles with fewer passes count with those they have. Covers all tiles once each has been
  /// requested after m was known.
  struct PassStats {
    ErrorEstimate estimate;
    std::int64_t samples = 0;
    std::optional<TrueErrorStats> truth;  // with a reference, once all tiles are measured
  };
  PassStats after_pass(const FrameKey& key, std::int32_t pass) const;

  /// Memory of the cached sums, without those that calls are using.
  std::int64_t used_bytes() const { return tiles_.used_bytes(); }

 private:
  struct Tile {
    std::vector<bool> committed;                  // by pass
    std::optional<double> luminance_sum;          // after pass 0
    std::vector<std::optional<ErrorSums>> error;  // after each pass, once m is known
    std::vector<std::optional<TrueSums>> truth;   // the same, with a reference
  };
  struct Frame {
    const FrameKey key;
    const contract::TileGrid grid;
    const std::uint32_t aovs;
    const std::vector<contract::Pass> passes;
    const BlockReader reader;
    Mutex mutex ABSL_ACQUIRED_AFTER(lock_order::kFilm)
        ABSL_ACQUIRED_BEFORE(lock_order::kCall){lock_order::kFilm};
    ReferenceReader reference ABSL_GUARDED_BY(mutex) = {};  // empty: none
    std::vector<Tile> tiles ABSL_GUARDED_BY(mutex) = {};
    std::int32_t tiles_without_luminance ABSL_GUARDED_BY(mutex) = 0;
    std::optional<double> mean_luminance ABSL_GUARDED_BY(mutex) = {};
    /// With a target error.
    std::unique_ptr<contract::PassRule> rule ABSL_GUARDED_BY(mutex) = {};
    /// `rule`, if the frame is denoised.
    contract::FrameStoppingRule* frame_rule ABSL_GUARDED_BY(mutex) = nullptr;
    /// Committed blocks that the rule has not received.
    bool has_unread_blocks ABSL_GUARDED_BY(mutex) = false;
    bool is_closed ABSL_GUARDED_BY(mutex) = false;
  };
  /// A locked frame; empty if it is not open. Clang does not see that a returned object holds a
  /// lock, so users call assert_held().
  struct LockedFrame {
    std::shared_ptr<Frame> frame;  // owners: the cache and calls
    std::unique_lock<Mutex> lock;
    explicit operator bool() const { return frame != nullptr; }
    Frame& operator*() const { return *frame; }
    Frame* operator->() const { return frame.get(); }
  };

  static void add_rule(const contract::RenderSettings& settings, Frame& frame)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  LockedFrame find(const FrameKey& key) const;
  absl::StatusOr<LockedFrame> find(const FrameKey& key, std::int32_t tile, std::int32_t pass) const;
  TileSum take(const Frame& frame, std::int32_t tile);
  TileSum take_measured(const Frame& frame, std::int32_t tile)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  absl::Status advance(Frame& frame, std::int32_t tile, TileSum& sum,
                       const contract::FilmBlock* block, std::int32_t end)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  absl::Status read_luminance(Frame& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  absl::Status catch_up(Frame& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  static PassStats stats_after(const Frame& frame, std::int32_t pass)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  static std::int32_t pass_target(const Frame& frame, std::int32_t tile)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  static void measure(Frame& frame, std::int32_t tile, TileSum& sum)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  void record_pass(Frame& frame, std::int32_t index, TileSum& sum)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  void measure_cached(Frame& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(frame.mutex);
  absl::StatusOr<TileSum> rebuild(const FrameKey& key, std::int32_t tile, bool keep);

  TileCache tiles_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::map<FrameKey, std::shared_ptr<Frame>> frames_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
