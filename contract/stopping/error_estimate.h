#pragma once

#include <cstdint>

namespace tessera::contract {

/// Sums of estimated squared errors over a set of pixels (docs/explanation/error-estimation.md).
/// Fold tiles in tile order: floating-point sums depend on the order.
struct ErrorSums {
  std::int64_t pixels = 0;
  double squared = 0;   // Σ over pixels and R, G, B of the variance of the mean
  double relative = 0;  // the same, each term divided by x̄₋ᵣ² + 0.01
  double scaled = 0;    // the same, each term divided by x̄₋ᵣ² + 0.01 m²; 0 without m
  double cautious = 0;  // the same, with a dark replicate in place of x̄₋ᵣ that rests on few samples
  /// Σ over pixels of the square of the pixel's cautious sum, for n_eff and the bound.
  double cautious_squares = 0;

  void add(const ErrorSums& other);
  /// Returns the sums without `part`, which must have been added before; exact up to rounding.
  ErrorSums without(const ErrorSums& part) const;
  /// Returns the sums as if every pixel's squared error were `factor` times as large.
  ErrorSums scaled_by(double factor) const;
};

/// Estimated errors over a set of pixels.
struct ErrorEstimate {
  double rmse = 0, relmse = 0;
  double error = 0;          // √mean of the scaled terms: the error that target errors refer to
  double error_upper95 = 0;  // √upper_mean()
  double n_eff = 0;          // (Σc)² / Σc² over the pixels' cautious sums c; 0 if all are 0
  std::int64_t pixels = 0;   // covered by the estimate; 0: there is none
};

/// Returns the mean of the scaled terms over pixels and channels, the square of
/// ErrorEstimate::error. Requires pixels > 0.
double mean_scaled(const ErrorSums& sums);

/// Returns the mean of the cautious terms over pixels and channels, on which decisions rest; at
/// least the square of ErrorEstimate::error. Requires pixels > 0.
double mean_cautious(const ErrorSums& sums);

/// Returns the quantile of the normal distribution for one of `looks` looks, each of which spends
/// 5 %/looks (a union bound).
double look_quantile(int looks);

/// Returns the upper bound of the true mean square at 95 % confidence after one of `looks` looks.
/// Requires pixels > 0.
///
/// The standard error of the estimate follows from the spread over pixels, times √R: with R
/// replicates and normal errors a pixel's estimate is σ²/R · χ²(R−1)/(R−1), while the true square
/// is σ²/R · χ²(1) and independent of it, so that their difference has R times the variance of the
/// estimate. Pixels are independent because their scrambles are.
///
/// With few pixels the estimate itself may be too small, and the normal quantile as well: the ratio
/// of truth and estimate is F-distributed with about n_eff and 3 n_eff degrees of freedom. Dividing
/// by 1 − z s/(2 mean) keeps the bound above that quantile, from 2 effective pixels on, within 30
/// %; with a single one the bound is too wide to meet any target.
double upper_mean(const ErrorSums& sums, int looks);

/// Returns all figures that a report derives from the sums.
ErrorEstimate estimate_error(const ErrorSums& sums, int looks = 1);

/// Returns n_eff = (Σc)² / Σc²: the number of pixels over which the error is effectively spread; 0
/// without error.
double effective_pixels(const ErrorSums& sums);

}  // namespace tessera::contract
