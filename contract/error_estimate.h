#pragma once

#include <cstdint>

namespace tessera::contract {

/// Sums of the film's estimated squared error over some pixels (design.md, section 4, "Report").
/// Adding is exact bookkeeping only when done in a fixed order: fold tiles in tile order.
struct ErrorSums {
  std::int64_t pixels = 0;
  double squared = 0;   // Σ over pixels, R, G, B of the variance of the mean
  double relative = 0;  // the same, each term over x̄₋ᵣ² + 0.01
  double scaled = 0;    // the same, each term over x̄₋ᵣ² + 0.01 m²; 0 without m
  /// Over pixels: the square of a pixel's scaled sum, for n_eff and the bound.
  double scaled_squares = 0;

  void add(const ErrorSums& other);
  /// The sums of the rest, if `part` is among what was added; within the rounding of the whole.
  ErrorSums without(const ErrorSums& part) const;
  /// The sums there would be if every pixel's error were `factor` times as large.
  ErrorSums scaled_by(double factor) const;
};

/// Estimated errors of the pixels in some ErrorSums.
struct ErrorEstimate {
  double rmse = 0, relmse = 0;
  double error = 0;          // √mean of the scaled terms: the contract's error
  double error_upper95 = 0;  // √upper_mean
  double n_eff = 0;          // (Σc)² / Σc² over the pixels' scaled sums c; 0 if all are 0
  std::int64_t pixels = 0;   // covered by the estimate; 0: there is none
};

/// Mean over pixels and channels of the scaled terms: the square of the contract's error.
/// Requires pixels > 0.
double mean_scaled(const ErrorSums& sums);

/// What the true mean square stays below with 95 % confidence after one of `looks` looks, each of
/// which spends 5 %/looks (a union bound). Requires pixels > 0.
///
/// The estimate's standard error is taken from the pixels' spread, times √R: with R replicates and
/// normal errors a pixel's estimate is σ²/R · χ²(R−1)/(R−1), while the square it stands for is
/// σ²/R · χ²(1) and independent of it, so that their difference has R times the estimate's
/// variance. Pixels are independent, as their scrambles are.
double upper_mean(const ErrorSums& sums, int looks);

/// Everything a report says of the sums.
ErrorEstimate estimate_error(const ErrorSums& sums, int looks = 1);

/// (Σc)² / Σc²: how many pixels the error is effectively spread over; 0 if there is none.
double effective_pixels(const ErrorSums& sums);

}  // namespace tessera::contract
