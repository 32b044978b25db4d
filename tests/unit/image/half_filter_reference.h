#pragma once

#include "image/denoise/half_filter.h"

namespace tessera::image {

/// filter_half() one pixel at a time, as its description says it.
FilteredHalf reference_filter_half(const Half& half);

}  // namespace tessera::image
