#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "contract/index.h"
#include "contract/pass_schedule.h"
#include "contract/stopping/pass_rule.h"

namespace tessera::contract {

/// Decides on passes in a job with a target error that is denoised. The error of a denoised frame
/// is known for the whole frame only, so all tiles stop at the look at which its bound is met.
///
/// Look p >= 1 is due when every tile has the passes that it was given so far, unless p is the last
/// pass. The owner of the rule then denoises the frame and reports its error and bound. If the
/// bound is not met, the look plans after which pass each tile should stop, so that the frame meets
/// the bound with few samples. A tile gets the passes of its plan up to pass p + 1. A tile that is
/// planned to stop where it is waits, and a later look may give it more passes. Tiles without noise
/// stop after pass 1.
///
/// The plan assumes that the squared error of the denoised frame is divided among the tiles as
/// their raw squared error is, and falls with it as 1/n. Tiles are compared by their raw error
/// only: a choice by the denoised error would favour tiles whose estimate is too small by chance.
class FrameStoppingRule final : public PassRule {
 public:
  /// `error` is the target E > 0. Requires at least one pass, one tile, and pixels > 0 for each
  /// tile.
  FrameStoppingRule(double error, std::vector<Pass> passes, std::vector<std::int64_t> tile_pixels);

  void add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums) override;
  std::vector<PassTarget> take_changes() override { return std::exchange(changes_, {}); }
  std::int32_t pass_count(std::int32_t tile) const override;
  std::int64_t expected_samples() const override { return expected_samples_; }
  int looks() const override { return looks_; }
  std::int32_t capped_tile_count() const override { return capped_tiles_; }
  bool is_futile() const override { return is_futile_; }

  /// The target E.
  double error() const { return error_; }
  /// Returns p of the look for which the frame waits to be denoised; nullopt if it does not wait.
  std::optional<std::int32_t> due_look() const;
  /// The denoised frame at a look.
  struct LookResult {
    double error = 0, bound = 0;   // estimated error and its upper bound
    bool is_concentrated = false;  // few pixels carry the error
  };
  /// Reports the result of the look that is due. Ignored if no look is due.
  void end_look(const LookResult& result);

 private:
  struct Tile {
    std::int64_t pixels = 0;
    std::int32_t wanted = 0;  // last pass that it is given so far
    std::int32_t seen = -1;   // latest pass with sums
    bool stopped = false;
    /// After pass `seen`: Σ over pixels of the cautious squared error, and of its square.
    double square = 0, pixel_squares = 0;
    double weight = 0;  // set by a look: fall of the frame's bound² per sample, times samples²
    std::int64_t expected_samples = 0;
  };

  std::int32_t last_pass() const { return static_cast<std::int32_t>(passes_.size()) - 1; }
  /// Samples per pixel up to and including a pass.
  double samples_after(std::int32_t pass) const { return passes_[as_index(pass)].end(); }
  void expect(Tile& tile, double samples_per_pixel);
  void stop(std::int32_t index);
  void stop_all();
  bool is_futile_after(const LookResult& result) const;
  std::optional<double> plan(const LookResult& result);
  void set_weights(const LookResult& result);
  double worth(const Tile& tile, std::int32_t pass) const;
  std::int32_t planned_pass(const Tile& tile, double level) const;
  double predicted_square(const LookResult& result, double level) const;

  double error_;
  std::vector<Pass> passes_;
  std::vector<Tile> tiles_;
  int looks_;
  std::int32_t pass_;    // the last pass that any tile is given so far
  std::int32_t active_;  // tiles that have not stopped
  std::int32_t behind_;  // those of them that have not finished their passes
  std::vector<PassTarget> changes_;
  std::int64_t expected_samples_ = 0;  // of all tiles
  std::int32_t capped_tiles_ = 0;
  bool is_futile_ = false;
};

}  // namespace tessera::contract
