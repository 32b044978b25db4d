#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "image/denoise/filter/half_filter.h"
#include "image/denoise/filter/rolling_rows.h"

namespace tessera::image {

/// Images that a half is mixed from: raw, zero-order, first-order.
constexpr std::size_t kCandidates = 3;
/// The same, followed by those of the frame fused with its neighbours.
constexpr std::size_t kFusedCandidates = 2 * kCandidates;

template <std::size_t kCount>
using CandidatePairs = std::array<const StreamPair*, kCount>;
/// Shares of the candidates: at least 0, and 1 in sum.
template <std::size_t kCount>
using Shares = std::array<float, kCount>;

/// Products of the errors of the candidates: row by row, the lower half of a symmetric matrix.
template <std::size_t kCount>
using Products = std::array<double, kCount*(kCount + 1) / 2>;

/// Cells around one whose products count for its shares.
constexpr std::int32_t kPooledCells = 2;

/// Adds the products of the candidates' relative errors at pixel `i`, up to a constant that all
/// share: one stream measures the other's error. kCount is kCandidates or kFusedCandidates.
template <std::size_t kCount>
void add_products(const CandidatePairs<kCount>& candidates, const ColourPlanes& guide,
                  std::size_t i, Products<kCount>& sums);

/// The shares with the least error over the cells around one.
Shares<kCandidates> best_shares(const RollingRows<Products<kCandidates>>& cells,
                                std::int32_t column, std::int32_t row);
/// The best mixture of two: the best one of the frame alone, and the best one of the fused frame.
Shares<kFusedCandidates> best_shares(const RollingRows<Products<kFusedCandidates>>& cells,
                                     std::int32_t column, std::int32_t row);

}  // namespace tessera::image
