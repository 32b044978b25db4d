#pragma once

#include <cstdint>

#include "image/denoise/denoised_error.h"
#include "image/denoise/half_denoiser.h"

namespace tessera::image {

/// Adds the estimated errors of the pixels inside the margin of both halves, row by row.
void add_errors(const BlendedHalf& first, const BlendedHalf& second, DenoiseSums& sums);

}  // namespace tessera::image
