#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "contract/pass_schedule.h"
#include "contract/stopping/pass_rule.h"

namespace tessera::contract {

/// Decides on passes by the raw image, tile by tile.
///
/// Tiles stop as a whole, not single pixels. Whether a tile gets pass p + 1 depends on its sums
/// after pass p and on look p − 1, which is taken when every tile is settled at p − 1; so no tile
/// waits for the slowest one.
///
/// Each look predicts, with squared error falling as 1/n, where every active tile should stop to
/// meet the frame's bound with fewest samples (∝ σ: the ratio of square to samples is at most one λ
/// for all), then scales the prediction to use the remaining budget E². A tile stops once its own
/// sums, with the others as predicted, meet the frame's bound, so tiles that stop never use up the
/// budget of others.
///
/// If few pixels carry the frame's error, their events are rare, and the bound falls with the luck
/// of the next samples. The frame gives up once even a square that falls as 1/n², as that of events
/// already seen, would not meet E² by the last pass.
class StoppingRule final : public PassRule {
 public:
  /// `error` is the target E > 0. Requires at least one pass, one tile, and pixels > 0 for each
  /// tile.
  StoppingRule(double error, std::vector<Pass> passes, std::vector<std::int64_t> tile_pixels);

  void add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums) override;
  std::vector<PassTarget> take_changes() override;
  std::int32_t pass_count(std::int32_t tile) const override;
  std::int64_t expected_samples() const override;
  int looks() const override { return looks_; }
  std::int32_t capped_tile_count() const override { return capped_tiles_; }
  bool is_futile() const override { return futile_look_.has_value(); }

 private:
  struct Tile {
    std::int64_t pixels = 0;
    std::int32_t pass_count = 0;  // wanted
    std::int32_t seen = -1;       // latest pass with sums
    bool stopped = false;
    ErrorSums newest, before;  // after passes `seen` and `seen` − 1
    /// Sums of the other tiles at their end, as predicted by the latest look; none: E² cannot be
    /// met.
    std::optional<ErrorSums> others;
  };
  /// A tile as seen by a look at some pass.
  struct Seen {
    const ErrorSums& sums;
    bool is_active;  // it continued after that pass
  };

  std::int32_t tile_count() const { return static_cast<std::int32_t>(tiles_.size()); }
  std::int32_t last_pass() const { return static_cast<std::int32_t>(passes_.size()) - 1; }
  /// Samples per pixel up to and including a pass.
  double samples_after(std::int32_t pass) const;
  void decide(std::int32_t index);
  void stop(Tile& tile);
  bool may_stop(const Tile& tile) const;
  bool is_futile_after(std::int32_t pass) const;
  void take_look(std::int32_t pass);
  static Seen as_of(const Tile& tile, std::int32_t pass);
  /// Predicted sums of the frame: of stopped and of active tiles.
  struct Prediction {
    ErrorSums stopped, active;
  };
  double level(std::int32_t pass) const;
  std::int32_t predicted_pass(const ErrorSums& sums, std::int32_t pass, double lambda) const;
  Prediction predict(std::int32_t pass, double lambda) const;
  double bound(const Prediction& predicted, double factor = 1) const;
  double scale_to_fill(const Prediction& predicted) const;
  void set_predictions(std::int32_t pass, double lambda);

  double target_;  // E²
  double frame_pixels_ = 0;
  std::vector<Pass> passes_;
  std::vector<Tile> tiles_;
  int looks_;
  std::vector<std::int32_t> unsettled_;  // by pass: tiles that are not settled at it
  std::vector<bool> look_taken_;         // by pass of the look
  std::vector<PassTarget> changes_;
  std::int64_t wanted_samples_ = 0, predicted_samples_ = 0;
  std::int32_t capped_tiles_ = 0;
  std::optional<std::int32_t> futile_look_;  // the first look at which the target was out of reach
};

}  // namespace tessera::contract
