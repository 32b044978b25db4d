#pragma once

#include "absl/status/statusor.h"
#include "contract/tile_grid.h"
#include "tests/support/seeded_frames.h"

namespace tessera::bench {

using testing::Image;

/// What frames are measured against.
struct Reference {
  Image mean, variance;                       // of the mean
  double luminance = 0, luminance_error = 0;  // mean luminance, its standard error
};

/// Sixteen frames of `spp` samples in all, of seeds that nothing else uses.
absl::StatusOr<Reference> render_reference(testing::SeededRenderer& renderer,
                                           const contract::TileGrid& grid, std::int32_t spp);

/// Mean over pixels and channels of (x − ref)² less the reference's own variance, over
/// ref² + 0.01 m²: the square of the contract's error.
double true_square(const Image& image, const Reference& reference, double m);

/// Mean over pixels and channels of a variance over ref² + 0.01 m².
double scaled_variance(const Image& variance, const Reference& reference, double m);

}  // namespace tessera::bench
