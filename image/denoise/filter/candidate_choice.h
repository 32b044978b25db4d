#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "image/denoise/filter/half_filter.h"
#include "image/denoise/filter/rolling_rows.h"

namespace tessera::image {

/// Images that a half is mixed from: raw, zero-order, first-order.
constexpr std::size_t kCandidates = 3;
using CandidatePairs = std::array<const StreamPair*, kCandidates>;
/// Shares of the candidates: at least 0, and 1 in sum.
using Shares = std::array<float, kCandidates>;

/// Products of the errors of the candidates: row by row, the lower half of a symmetric matrix.
constexpr std::size_t kProducts = kCandidates * (kCandidates + 1) / 2;
using Products = std::array<double, kProducts>;

/// Cells around one whose products count for its shares.
constexpr std::int32_t kPooledCells = 2;

/// Adds the products of the candidates' relative errors at pixel `i`, up to a constant that all
/// share: one stream measures the other's error.
void add_products(const CandidatePairs& candidates, const ColourPlanes& guide, std::size_t i,
                  Products& sums);

/// The shares with the least error over the cells around one.
Shares best_shares(const RollingRows<Products>& cells, std::int32_t column, std::int32_t row);

}  // namespace tessera::image
