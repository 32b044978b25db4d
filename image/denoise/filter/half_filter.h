#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace tessera::image {

constexpr int kHalfFeatures = 8;
using Plane = std::vector<float>;
using ColourPlanes = std::array<Plane, 3>;

/// The results of a filter for both streams of a half.
struct StreamPair {
  ColourPlanes a, b;
};

/// Pixels around those that are filtered; the filters read all of them.
constexpr std::int32_t kHalfMargin = 8;
/// Width of a half with this border, at most.
constexpr std::int32_t kMaxHalfWidth = 184;

/// A half of the replicates: pixels to be filtered with a border of kHalfMargin pixels, row by row,
/// colours in units of the mean luminance. Pixels beyond the frame repeat its border and are not
/// valid.
struct Half {
  std::int32_t width = 0, height = 0;  // with the border; width is a multiple of 8
  StreamPair streams;
  std::array<Plane, kHalfFeatures> features;         // means of both streams
  Plane albedo_weight, normal_weight, depth_weight;  // 1 / squared tolerance
  Plane valid;                                       // 1 or 0

  /// Index of the first pixel of a row inside the border.
  std::size_t inside(std::int32_t row) const {
    return static_cast<std::size_t>(row + kHalfMargin) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(kHalfMargin);
  }
};

/// Result of the first filter: the mean of both streams, and its variance summed over the channels.
struct Guide {
  ColourPlanes colour;
  Plane variance;
};

/// Results of the second filter.
struct Candidates {
  StreamPair zero_order, first_order;
};

/// Computes features and weights of a half from the features of its streams; weights are defined
/// from one pixel from the border on.
void prepare(const std::array<Plane, kHalfFeatures>& features_a,
             const std::array<Plane, kHalfFeatures>& features_b, Half& half);

/// Filters a half with its own colours as the guide. Vectorised; equal bit for bit to the
/// reference. The result has the size of the half and is defined inside the border.
Guide filter_guide(const Half& half);

/// Filters a half with `guide`, which must have the values of all pixels of the half that are at
/// most 5 pixels beyond the frame. Otherwise as filter_guide().
Candidates filter_candidates(const Half& half, const Guide& guide);

}  // namespace tessera::image
