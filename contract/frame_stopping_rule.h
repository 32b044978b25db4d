#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "contract/pass_rule.h"
#include "contract/pass_schedule.h"

namespace tessera::contract {

/// Decides on passes in a job with a target error that is denoised: the error of a denoised frame
/// is known for the whole frame only, so its tiles stop together.
///
/// Look p >= 1 is due when every tile that has not stopped has finished pass p, unless it is the
/// last. The owner of the rule then denoises the frame and reports whether its bound is met. If it
/// is not, all tiles get the next pass, except for tiles without noise, which have stopped.
class FrameStoppingRule final : public PassRule {
 public:
  /// `error` is the target E > 0. Requires at least one pass, one tile, and pixels > 0 for each
  /// tile.
  FrameStoppingRule(double error, std::vector<Pass> passes, std::vector<std::int64_t> tile_pixels);

  void add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums) override;
  std::vector<PassTarget> take_changes() override { return std::exchange(changes_, {}); }
  std::int32_t pass_count(std::int32_t tile) const override;
  std::int64_t expected_samples() const override;
  int looks() const override { return looks_; }
  std::int32_t capped_tile_count() const override { return capped_tiles_; }
  bool is_futile() const override { return false; }

  /// The target E.
  double error() const { return error_; }
  /// Returns the pass after which the frame waits to be denoised; nullopt if it does not wait.
  std::optional<std::int32_t> due_look() const;
  /// Reports whether the bound is met at the look that is due, and the bound. Ignored if no look is
  /// due.
  void end_look(bool is_met, double bound);

 private:
  struct Tile {
    std::int64_t pixels = 0;
    std::int32_t seen = -1;  // latest pass with sums
    bool stopped = false;
  };

  std::int32_t last_pass() const { return static_cast<std::int32_t>(passes_.size()) - 1; }
  void stop(std::int32_t index);

  double error_;
  std::vector<Pass> passes_;
  std::vector<Tile> tiles_;
  int looks_;
  std::int32_t pass_;    // the last pass that is wanted so far of tiles that have not stopped
  std::int32_t active_;  // tiles that have not stopped
  std::int32_t behind_;  // those of them that have not finished `pass_`
  std::vector<PassTarget> changes_;
  std::int64_t stopped_samples_ = 0, active_pixels_ = 0;
  double expected_spp_;  // of tiles that have not stopped
  std::int32_t capped_tiles_ = 0;
};

}  // namespace tessera::contract
