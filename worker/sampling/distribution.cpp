#include "worker/sampling/distribution.h"

#include <algorithm>
#include <cmath>

#include "worker/math/vector.h"

namespace tessera::render {
namespace {

constexpr float kBelowOne = 0x1.fffffep-1f;

}  // namespace

DiscreteDistribution::DiscreteDistribution(std::span<const double> weights) {
  const auto usable = [](double w) { return w > 0 && std::isfinite(w) ? w : 0; };
  // Weights are divided by the largest, so that the sum of finite weights is finite.
  double largest = 0;
  for (const double w : weights) largest = usable(w) > largest ? usable(w) : largest;
  cdf_.assign(weights.size() + 1, 0);
  if (!(largest > 0)) return;
  double sum = 0;
  for (const double w : weights) sum += usable(w) / largest;
  // Every positive entry gets a width that does not round to zero next to 1.
  const double least = sum * 0x1p-50;
  sum = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double w = usable(weights[i]);
    if (w > 0) sum += w / largest > least ? w / largest : least;
    cdf_[i + 1] = sum;
  }
  total_ = sum * largest;
  for (std::size_t i = 1; i < cdf_.size(); ++i) cdf_[i] /= sum;
}

DiscreteDistribution::Choice DiscreteDistribution::sample(double u) const {
  // The first entry whose end lies above u: its start is at or below u, so its width is positive.
  // u < 1 and the last value of the table is exactly 1.
  const auto end = std::upper_bound(cdf_.begin() + 1, cdf_.end() - 1, u);
  auto index = static_cast<std::size_t>(end - cdf_.begin()) - 1;
  while (cdf_[index + 1] == cdf_[index]) --index;  // u >= 1 only: back to the last positive entry
  const double width = cdf_[index + 1] - cdf_[index];
  Choice choice;
  choice.index = static_cast<std::int32_t>(index);
  choice.pdf = probability(choice.index);
  const auto remapped = static_cast<float>((u - cdf_[index]) / width);
  choice.remapped = clamp(remapped, 0.0f, kBelowOne);
  return choice;
}

}  // namespace tessera::render
