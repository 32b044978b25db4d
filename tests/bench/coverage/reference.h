#pragma once

#include "absl/status/statusor.h"
#include "contract/tile_grid.h"
#include "tests/support/render/seeded_frames.h"

namespace tessera::bench {

using testing::Image;

/// The reference image.
struct Reference {
  Image mean, variance;                       // variance of the mean
  double luminance = 0, luminance_error = 0;  // mean luminance, its standard error
};

/// Renders sixteen frames with `spp` samples in total and seeds that are used for nothing else.
absl::StatusOr<Reference> render_reference(testing::SeededRenderer& renderer,
                                           const contract::TileGrid& grid, std::int32_t spp);

/// Returns the mean over pixels and channels of ((x − ref)² − variance of ref) / (ref² + 0.01 m²),
/// the square of the contract's error.
double true_square(const Image& image, const Reference& reference, double m);

/// Returns the mean over pixels and channels of variance / (ref² + 0.01 m²).
double scaled_variance(const Image& variance, const Reference& reference, double m);

}  // namespace tessera::bench
