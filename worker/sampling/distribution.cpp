#include "worker/sampling/distribution.h"

#include <algorithm>
#include <cmath>

#include "worker/math/float_bits.h"

namespace tessera::render {
namespace {

constexpr float kBelowOne = 0x1.fffffep-1f;

/// The cell of an axis of `count` cells that holds x in [0, 1).
std::int32_t cell_of(float x, std::int32_t count) {
  const double scaled = std::floor(static_cast<double>(x) * count);
  return static_cast<std::int32_t>(clamp(scaled, 0.0, static_cast<double>(count - 1)));
}

/// A float inside cell `index`, close to (index + offset) / count. Where rounding to float crosses
/// the cell's boundary, the nearest float inside is returned, so that pdf() finds the same cell.
float place_in_cell(std::int32_t index, float offset, std::int32_t count) {
  const double wanted = (static_cast<double>(index) + static_cast<double>(offset)) / count;
  auto x = static_cast<float>(wanted);
  while (cell_of(x, count) > index || x >= 1) x = next_down(x);
  while (cell_of(x, count) < index) x = next_up(x);
  return x;
}

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

PiecewiseConstant2d::PiecewiseConstant2d(std::span<const double> weights, std::int32_t width,
                                         std::int32_t height)
    : width_(width), height_(height) {
  std::vector<double> row_totals;
  columns_.reserve(static_cast<std::size_t>(height));
  for (std::int32_t row = 0; row < height; ++row) {
    const auto first = static_cast<std::size_t>(row) * static_cast<std::size_t>(width);
    columns_.emplace_back(weights.subspan(first, static_cast<std::size_t>(width)));
    row_totals.push_back(columns_.back().total());
  }
  rows_ = DiscreteDistribution(row_totals);
}

PiecewiseConstant2d::Sample PiecewiseConstant2d::sample(double u, double v) const {
  const DiscreteDistribution::Choice row = rows_.sample(v);
  const DiscreteDistribution::Choice column =
      columns_[static_cast<std::size_t>(row.index)].sample(u);
  return {{place_in_cell(column.index, column.remapped, width_),
           place_in_cell(row.index, row.remapped, height_)},
          cell_pdf(column.index, row.index)};
}

float PiecewiseConstant2d::pdf(Vec2f point) const {
  const bool inside = point.x >= 0 && point.x < 1 && point.y >= 0 && point.y < 1;
  if (!inside || empty()) return 0;
  return cell_pdf(cell_of(point.x, width_), cell_of(point.y, height_));
}

float PiecewiseConstant2d::cell_pdf(std::int32_t column, std::int32_t row) const {
  const DiscreteDistribution& columns = columns_[static_cast<std::size_t>(row)];
  if (columns.empty()) return 0;
  const double row_density = static_cast<double>(rows_.probability(row)) * height_;
  return static_cast<float>(static_cast<double>(columns.probability(column)) * width_ *
                            row_density);
}

std::int64_t PiecewiseConstant2d::memory_bytes() const {
  std::int64_t bytes = rows_.memory_bytes();
  for (const DiscreteDistribution& row : columns_) {
    bytes += row.memory_bytes() + static_cast<std::int64_t>(sizeof(DiscreteDistribution));
  }
  return bytes;
}

}  // namespace tessera::render
