#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/render_settings.h"
#include "contract/stopping/error_estimate.h"
#include "contract/version.h"

namespace tessera::server {

using contract::ErrorEstimate;
using contract::ErrorSums;

/// Sums over pixels and R, G, B of the difference between an image and its reference.
struct TrueSums {
  double squared = 0;   // Σ (x − ref)²
  double relative = 0;  // the same, each term over ref² + 0.01
  double scaled = 0;    // the same, each term over ref² + 0.01 m²; 0 without m

  void add(const TrueSums& other);
};

/// Errors derived from TrueSums, defined as in image/metrics/image_metrics.h.
struct TrueErrorStats {
  double rmse = 0, relmse = 0;
  std::optional<double> error;  // none without m
};

/// Sums of all passes of a tile, in double.
///
/// A pure function of the blocks added: passes come in order; each block's floats are widened
/// exactly and added in pass order. The result does not depend on when a block arrived
/// (docs/explanation/determinism.md).
class TileSum {
 public:
  /// An empty tile. Requires 1 <= width, height <= 256.
  TileSum(std::int32_t width, std::int32_t height, std::uint32_t aovs);

  /// Adds the block of the next pass, which rendered samples `pass` of every pixel.
  ///
  /// Errors: InvalidArgument, the block has another shape, or `pass` does not follow the samples
  /// added so far. The tile is then unchanged.
  absl::Status add(const contract::FilmBlock& block, const contract::Pass& pass);

  struct Size {
    std::int32_t width = 0, height = 0;
  };
  Size size() const { return {width_, height_}; }
  std::int64_t pixel_count() const { return std::int64_t{width_} * height_; }
  std::int32_t pass_count() const { return pass_count_; }
  /// Samples per pixel of the passes so far, dropped ones included.
  std::int32_t sample_count() const { return sample_count_; }
  /// Samples and energy that are missing from the means.
  struct Losses {
    std::int64_t dropped_count = 0;
    double clamped_energy = 0, truncated_energy = 0;
    std::uint64_t transparency_limit_count = 0;
  };
  const Losses& losses() const { return losses_; }
  /// Approximate memory use.
  std::int64_t bytes() const;

  /// Number of samples in the mean of `pixel` (row-major).
  std::int32_t kept(std::int64_t pixel) const;
  /// R, G, B, A: float32 of (double sum ÷ kept samples); zeros if no sample was kept.
  void rgba(std::int64_t pixel, std::span<float, 4> out) const;
  /// Standard errors of the pixel's R, G, B from the spread of its replicates; 0 with fewer than
  /// two replicates.
  void standard_error(std::int64_t pixel, std::span<float, 3> out) const;
  /// Albedo or normal: sum over camera hits ÷ hits, 0 without hits. Require their Aov bit.
  void albedo(std::int64_t pixel, std::span<float, 3> out) const;
  void normal(std::int64_t pixel, std::span<float, 3> out) const;
  /// Values of a pixel for the denoiser. Requires kAovDenoising.
  struct DenoisingValues {
    /// Means of R, G, B over the samples that each replicate kept.
    std::array<std::array<float, 3>, contract::kReplicates> rgb{};
    /// Albedo and normal ÷ kept samples (0 for samples that hit nothing), depth ÷ hits, and the
    /// share of samples that hit something.
    std::array<std::array<float, contract::kFeatures>, contract::kReplicates> features{};
  };
  DenoisingValues denoising_values(std::int64_t pixel) const;
  /// Mean rays, nodes and primitives of a sample, dropped samples included. Requires its Aov bit.
  void traversal_cost(std::int64_t pixel, std::span<float, 3> out) const;
  /// Layers of sample 0; zeros before pass 0. Empty without their Aov bit.
  struct FirstSample {
    std::vector<float> depth, position, motion;
    std::vector<std::uint32_t> ids;
  };
  const FirstSample& first_sample() const { return first_sample_; }

  /// Returns the sum over pixels of the luminance 0.2126 R + 0.7152 G + 0.0722 B of their means.
  /// After pass 0 of every tile, folded in tile order and divided by the number of pixels, this
  /// gives m.
  double luminance_sum() const;

  /// Returns the estimated error of the tile (docs/explanation/error-estimation.md).
  /// `mean_luminance` is m >= 0. If `per_pixel` is not null, each pixel's scaled sum is appended to
  /// it, row-major.
  ErrorSums error_sums(double mean_luminance, std::vector<double>* per_pixel = nullptr) const;
  /// The result of error_sums(), and the largest scaled sums of single pixels.
  struct Measured {
    static constexpr std::size_t kLargest = 64;
    double mean_luminance = 0;
    ErrorSums sums;
    std::vector<double> largest;  // the smallest one first; all of a tile of up to kLargest pixels
  };
  /// Returns error_sums(), and keeps it until the next add().
  const ErrorSums& measure(double mean_luminance);
  /// Returns what measure() has kept; nullptr if that is not for this `mean_luminance`.
  const Measured* measured(double mean_luminance) const {
    return measured_ && measured_->mean_luminance == mean_luminance ? &*measured_ : nullptr;
  }
  /// Returns the error against `reference`, R, G, B, A of each pixel. `mean_luminance` is m >= 0.
  TrueSums true_sums(std::span<const float> reference, double mean_luminance) const;

 private:
  /// Means of one channel of a pixel, one per replicate that kept a sample.
  struct ReplicateMeans {
    double value[contract::kReplicates];
    int count = 0;
  };

  /// Samples of replicate `r` of `pixel` that were kept.
  std::int32_t kept(std::int64_t pixel, int r) const;
  ReplicateMeans replicate_means(std::int64_t pixel, int channel) const;
  void over_hits(const std::vector<double>& sums, std::int64_t pixel,
                 std::span<float, 3> out) const;

  std::int32_t width_, height_;
  std::uint32_t aovs_;
  std::int32_t pass_count_ = 0, sample_count_ = 0;
  Losses losses_;
  std::vector<double> rgb_;    // [pixel][replicate][channel]
  std::vector<double> alpha_;  // [pixel]
  std::vector<double> albedo_, normal_, hits_;
  std::vector<double> features_;  // [pixel][replicate][kFeatures]
  std::vector<double> traversal_cost_;
  FirstSample first_sample_;
  std::vector<std::int32_t> dropped_;  // [pixel][replicate]; empty if nothing was dropped
  std::optional<Measured> measured_;
};

}  // namespace tessera::server
