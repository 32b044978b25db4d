#pragma once

#include <cstdint>

#include "image/denoise/filter/half_filter.h"

namespace tessera::image {

/// Pixels around those that are limited; limit_spikes() reads all of them.
constexpr std::int32_t kSpikeMargin = 4;

/// Scales down spikes, which are light of rare paths: a filter could only spread them.
///
/// A spike is a pixel whose colour in one stream, R + G + B, is more than kSpikeFactor times both
/// that in the other stream and the second largest among the neighbours in both streams. It gets
/// the larger one of these two. What both streams see is kept, however small it is. Where more than
/// kMaxSpikes are within 7 x 7 pixels, they are not rare but the light itself, and are kept.
///
/// The planes have `width` columns. `valid`: 1 for pixels of the frame; others do not count. Pixels
/// less than kSpikeMargin from the border of the planes are left alone.
void limit_spikes(const Plane& valid, std::int32_t width, StreamPair& streams);

}  // namespace tessera::image
