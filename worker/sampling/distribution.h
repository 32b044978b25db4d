#pragma once

#include <cstdint>
#include <span>
#include <vector>

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

}  // namespace tessera::render
