#pragma once

#include "image/denoise/filter/half_filter.h"

namespace tessera::image {

/// Results of both filters.
struct FilteredHalf {
  ColourPlanes guide;
  Candidates candidates;
};

/// filter_guide(), then filter_candidates() with its result, one pixel at a time, as their
/// descriptions say it. The candidates are defined 2 kHalfMargin pixels from the border on.
FilteredHalf reference_filter_half(const Half& half);

}  // namespace tessera::image
