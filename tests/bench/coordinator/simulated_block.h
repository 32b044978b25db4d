#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "contract/digest.h"
#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/render_settings.h"

namespace tessera::bench {

/// Fabricated film blocks whose merged image is known exactly.
///
/// Every tile of a pass is the same pseudo-random square, incompressible like a noisy render,
/// except for one value that encodes the tile's index, so that a block merged at the wrong place
/// is detected. Values are in [0.5, 2) with 20 bits, so sums over passes are exact in double.
class SimulatedFilm {
 public:
  /// Requires a window whose sides are multiples of the tile, and no additional layers.
  explicit SimulatedFilm(const contract::RenderSettings& settings);

  /// The encoded block of a unit. Requires a tile and pass of the job.
  std::string block(std::int32_t tile, std::int32_t pass) const;

  /// SHA-256 of the finished frame's pixels, in the form of the report
  /// (docs/reference/output-files.md).
  contract::Digest expected_pixels() const;

  std::int64_t unit_count() const;
  std::int64_t block_bytes() const { return block_bytes_; }

 private:
  contract::FilmBlock pass_block(std::int32_t tile, std::size_t pass) const;

  contract::RenderSettings settings_;
  std::vector<contract::Pass> passes_;
  std::vector<contract::FilmBlock> templates_;  // one per pass
  std::int64_t block_bytes_ = 0;
};

}  // namespace tessera::bench
