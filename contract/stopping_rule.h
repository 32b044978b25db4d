#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "contract/error_estimate.h"
#include "contract/pass_schedule.h"

namespace tessera::contract {

/// Which passes the tiles of one frame want, in a job asked for by its error (farm.md, section 5).
///
/// A pure function of the figures it is given, whatever their order: tiles stop, never pixels.
/// Passes 0 and 1 are always wanted. Whether a tile wants pass p + 1 depends on its own figures
/// after pass p and on look p − 1, which is taken when every tile is settled at p − 1; so nobody
/// waits for the slowest tile. With + − × ÷ √ and a table of quantiles only.
///
/// Every look shares out what tiles that have stopped leave of E²: it foresees, with squares
/// falling as 1/n, at which pass each tile should stop so that the frame's bound is met with the
/// fewest samples (those ∝ σ: square ÷ samples at most one λ for all), and scales what is foreseen
/// up to what is left. A tile stops once its own figures, with the others as foreseen, meet the
/// frame's bound, so those who stop never take from the others. A tile whose error sits in fewer
/// than 30 pixels goes on while it holds a thirtieth of what the frame may have.
class StoppingRule {
 public:
  /// `error`: E > 0. Requires at least one pass and one tile; pixels of each tile > 0.
  StoppingRule(double error, std::vector<Pass> passes, std::vector<std::int64_t> tile_pixels);

  /// Tells of a tile after its pass `pass`. Those of a tile count in order, others are ignored;
  /// harmless to repeat.
  void add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums);

  /// What is known now of how many passes a tile is to have.
  struct PassTarget {
    std::int32_t tile = 0;
    std::int32_t pass_count = 0;
    bool is_final = false;  // it has stopped
  };
  /// Demands that have changed since the last call.
  std::vector<PassTarget> take_changes();
  /// Passes the tile wants, as far as is known.
  std::int32_t pass_count(std::int32_t tile) const;

  /// Samples of the whole frame, done and foreseen.
  std::int64_t expected_samples() const;
  /// Looks among which the confidence is divided.
  int looks() const { return looks_; }
  /// Tiles that stopped only because the passes ended.
  std::int32_t capped_tile_count() const { return capped_tiles_; }
  /// Tiles whose error sat in fewer than kFewestPixels pixels, and held a thirtieth of what the
  /// frame may have, when they stopped.
  std::int32_t concentrated_tile_count() const { return concentrated_tiles_; }

  /// n_eff below which nothing is claimed (design.md, section 5).
  static constexpr double kFewestPixels = 30;

 private:
  struct Tile {
    std::int64_t pixels = 0;
    std::int32_t pass_count = 0;  // wanted
    std::int32_t seen = -1;       // newest pass with figures
    bool stopped = false;
    ErrorSums newest, before;  // after passes `seen` and `seen` − 1
    /// The other tiles when they stop, as the newest look foresees; none: E² cannot be met.
    std::optional<ErrorSums> others;
  };
  /// A tile as a look at some pass sees it.
  struct Seen {
    const ErrorSums& sums;
    bool is_active;  // it went on after that pass
  };

  std::int32_t tile_count() const { return static_cast<std::int32_t>(tiles_.size()); }
  std::int32_t last_pass() const { return static_cast<std::int32_t>(passes_.size()) - 1; }
  /// Samples of a pixel up to and including a pass.
  double samples_after(std::int32_t pass) const;
  void decide(std::int32_t index);
  void stop(Tile& tile);
  bool may_stop(const Tile& tile) const;
  bool is_concentrated(const ErrorSums& sums) const;
  double heavy(std::int64_t pixels) const;
  void take_look(std::int32_t pass);
  static Seen as_of(const Tile& tile, std::int32_t pass);
  /// Sums of the frame as foreseen: of tiles that have stopped, and of those that go on.
  struct Foreseen {
    ErrorSums stopped, active;
  };
  double level(std::int32_t pass) const;
  std::int32_t foreseen_pass(const ErrorSums& sums, std::int32_t pass, double lambda) const;
  Foreseen foresee(std::int32_t pass, double lambda) const;
  double bound(const Foreseen& foreseen, double factor = 1) const;
  double scale_to_fill(const Foreseen& foreseen) const;
  void share_out(std::int32_t pass, double lambda);

  double target_;  // E²
  double frame_pixels_ = 0;
  std::vector<Pass> passes_;
  std::vector<Tile> tiles_;
  int looks_;
  std::vector<std::int32_t> unsettled_;  // by pass: tiles not settled at it
  std::vector<bool> looked_;             // by the pass looked at
  std::vector<PassTarget> changes_;
  std::int64_t wanted_samples_ = 0, foreseen_samples_ = 0;
  std::int32_t capped_tiles_ = 0, concentrated_tiles_ = 0;
};

}  // namespace tessera::contract
