#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/math/vector.h"

namespace tessera::render {

/// Discrete distribution over n weights, sampled by inverting the cumulative sum in double, which
/// preserves stratification.
///
/// Exactly the entries with a positive weight have a positive probability, and for any u only they
/// are chosen. For tables of more than 2^12 entries, sample with more than the 24 bits of a float
/// (Sampler::get_4d_fine). Negative and non-finite weights count as 0; without a positive weight
/// the distribution is empty.
class DiscreteDistribution {
 public:
  DiscreteDistribution() = default;
  explicit DiscreteDistribution(std::span<const double> weights);

  struct Choice {
    std::int32_t index = 0;
    float pdf = 0;   // probability(index)
    float remapped;  // u rescaled within the entry, in [0, 1)
  };

  std::size_t size() const { return cdf_.empty() ? 0 : cdf_.size() - 1; }
  bool empty() const { return !(total_ > 0); }
  double total() const { return total_; }

  /// Samples with u in [0, 1). Requires !empty(). O(log n).
  Choice sample(double u) const;

  /// The probability of an entry, bit for bit the one that sample() returns for it.
  float probability(std::int32_t index) const {
    const auto i = static_cast<std::size_t>(index);
    return static_cast<float>(cdf_[i + 1] - cdf_[i]);
  }

  std::int64_t memory_bytes() const {
    return static_cast<std::int64_t>(cdf_.capacity() * sizeof(double));
  }

 private:
  std::vector<double> cdf_;  // n + 1 values from 0 to 1, rising only at positive weights
  double total_ = 0;
};

/// Density on the unit square that is constant on each cell of a width x height grid, as used for
/// environment maps. Samples the row first, then the column.
class PiecewiseConstant2d {
 public:
  PiecewiseConstant2d() = default;
  /// `weights` row-major. Requires width * height = weights.size().
  PiecewiseConstant2d(std::span<const double> weights, std::int32_t width, std::int32_t height);

  struct Sample {
    Vec2f point;    // in [0, 1)^2, inside the cell
    float pdf = 0;  // pdf(point), exactly
  };

  bool empty() const { return rows_.empty(); }
  double total() const { return rows_.total(); }

  /// Samples the column with `u` and the row with `v`, both in [0, 1). Requires !empty().
  Sample sample(double u, double v) const;

  /// Density with respect to area of the unit square; 0 outside it and when empty.
  float pdf(Vec2f point) const;

  std::int64_t memory_bytes() const;

 private:
  float cell_pdf(std::int32_t column, std::int32_t row) const;

  std::int32_t width_ = 0, height_ = 0;
  DiscreteDistribution rows_;
  std::vector<DiscreteDistribution> columns_;  // one per row
};

}  // namespace tessera::render
