#pragma once

#include <cstdint>
#include <vector>

#include "contract/stopping/error_estimate.h"

namespace tessera::contract {

/// Decides how many passes each tile of a frame gets in a job with a target error
/// (docs/explanation/error-estimation.md). A pure function of the sums that it is given, in any
/// order. Every tile gets passes 0 and 1. Uses only + − × ÷ √ and a table of quantiles.
class PassRule {
 public:
  virtual ~PassRule() = default;

  /// Adds a tile's sums after pass `pass`. Calls for a tile count in the order of passes; others
  /// are ignored. Idempotent.
  virtual void add(std::int32_t tile_index, std::int32_t pass, const ErrorSums& sums) = 0;

  /// Number of passes that a tile is known to get.
  struct PassTarget {
    std::int32_t tile = 0;
    std::int32_t pass_count = 0;
    bool is_final = false;  // the tile has stopped
  };
  /// Returns the targets that have changed since the last call.
  virtual std::vector<PassTarget> take_changes() = 0;
  /// Passes that the tile gets, as far as is known.
  virtual std::int32_t pass_count(std::int32_t tile) const = 0;

  /// Samples of the whole frame, done and predicted.
  virtual std::int64_t expected_samples() const = 0;
  /// Number of looks among which the confidence is divided.
  virtual int looks() const = 0;
  /// Tiles that stopped because the passes ended.
  virtual std::int32_t capped_tile_count() const = 0;
  /// Whether tiles stopped before the target because the samples left could not meet it.
  virtual bool is_futile() const = 0;

  /// Effective number of pixels below which the error is concentrated: the bound is wide then.
  static constexpr double kMinEffectivePixels = 30;
  /// Samples per pixel from which on a rule may find that more of them cannot meet the target.
  static constexpr double kMinFutileSamples = 256;
};

}  // namespace tessera::contract
