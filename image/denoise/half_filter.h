#pragma once

#include <array>
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

/// A half of the replicates around a tile: `width` by `height` pixels, row by row, colours in units
/// of the mean luminance. Pixels beyond the frame repeat its border and are not valid.
struct Half {
  std::int32_t width = 0, height = 0;  // width is a multiple of 8
  StreamPair streams;
  std::array<Plane, kHalfFeatures> features;         // means of both streams
  Plane albedo_weight, normal_weight, depth_weight;  // 1 / squared tolerance
  Plane valid;                                       // 1 or 0
};

/// The candidates, defined kFilterInset pixels from the border on.
struct FilteredHalf {
  ColourPlanes guide;
  StreamPair zero_order, first_order;
};

/// Width of the border of a Half in which its candidates are not defined.
constexpr std::int32_t kFilterInset = 16;

/// Computes features and weights of a half from the features of its streams.
void prepare(const std::array<Plane, kHalfFeatures>& features_a,
             const std::array<Plane, kHalfFeatures>& features_b, Half& half);

/// Filters a half. Vectorised; equal bit for bit to the reference.
FilteredHalf filter_half(const Half& half);

}  // namespace tessera::image
