#include "image/denoise/pixel_errors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "image/denoise/filter/filter_parameters.h"

namespace tessera::image {
namespace {

constexpr std::size_t kLanes = 4, kSide = 2 * kBlurMargin + 1;

/// kLanes neighbouring values of a row.
using Doubles = double __attribute__((vector_size(kLanes * sizeof(double))));

Doubles load_doubles(const double* from) {
  Doubles doubles;
  std::memcpy(&doubles, from, sizeof doubles);
  return doubles;
}

/// Raw values of a channel, and limits of what a filter may have made of them.
class RawValues {
 public:
  RawValues(const BlendedHalf& first, const BlendedHalf& second, std::size_t channel)
      : width_(static_cast<std::size_t>(first.width)) {
    const std::array<const BlendedHalf*, 2> halves = {&first, &second};
    for (std::size_t half = 0; half < 2; ++half) {
      const Plane &a = halves[half]->raw.a[channel], &b = halves[half]->raw.b[channel];
      values_[half].resize(a.size());
      for (std::size_t i = 0; i < a.size(); ++i)
        values_[half][i] = 0.5 * (static_cast<double>(a[i]) + b[i]);
    }
    // Means of 3 x 3 pixels.
    means_.resize(values_[0].size());
    for (std::size_t i = width_ + 1; i + width_ + 1 < means_.size(); ++i) {
      double sum = 0;
      for (const std::size_t row : {i - width_, i, i + width_}) {
        for (const std::vector<double>& values : values_)
          sum += values[row - 1] + values[row] + values[row + 1];
      }
      means_[i] = sum / 18;
    }
  }

  /// For each half its value of a pixel, but at least the darkest mean of both halves over nine
  /// pixels of which it is a corner.
  std::array<double, 2> limits(std::size_t i) const {
    const std::size_t above = i - width_, below = i + width_;
    const double darkest =
        std::min({means_[above - 1], means_[above + 1], means_[below - 1], means_[below + 1]});
    return {std::max(values_[0][i], darkest), std::max(values_[1][i], darkest)};
  }

 private:
  std::size_t width_;
  std::array<std::vector<double>, 2> values_;
  std::vector<double> means_;
};

/// The scales of the pixels' relative errors in one channel: their values, but at most the means
/// around them, so that a bright outlier is not measured against itself, and at most what the raw
/// image has there, so that light which a filter has spread into the dark is not either. Each half
/// has its own scale, with its own raw value of the pixel: the other half's measures its error.
class ReferenceValues {
 public:
  ReferenceValues(const BlendedHalf& first, const BlendedHalf& second, std::size_t channel)
      : raw_(first, second, channel), width_(static_cast<std::size_t>(first.width)) {
    const Plane &a = first.colour[channel], &b = second.colour[channel];
    values_.resize(a.size() + kLanes);  // vectors may begin with any value that is needed
    for (std::size_t i = 0; i < a.size(); ++i)
      values_[i] = std::fabs(0.5 * (static_cast<double>(a[i]) + b[i]));
    means_.resize(width_ + kLanes);
  }

  /// Finds the means of the pixels inside the margin of a row; the first pixel of the row has
  /// index `begin`.
  void use_row(std::size_t begin) {
    const double* top = values_.data() + begin - kBlurMargin * width_ - kBlurMargin;
    for (std::size_t x = kBlurMargin; x < width_ - kBlurMargin; x += kLanes) {
      Doubles sum = {};
      for (std::size_t row = 0; row < kSide; ++row) {
        for (std::size_t column = 0; column < kSide; ++column)
          sum += load_doubles(top + row * width_ + x + column);
      }
      sum /= static_cast<double>(kSide * kSide);
      std::memcpy(&means_[x], &sum, sizeof sum);
    }
    row_ = values_.data() + begin;
  }

  std::array<double, 2> at(std::size_t x) const {
    const auto i = static_cast<std::size_t>(row_ - values_.data()) + x;
    const double both = std::min(row_[x], means_[x]);
    const auto [first, second] = raw_.limits(i);
    return {std::min(both, first), std::min(both, second)};
  }

 private:
  RawValues raw_;
  std::size_t width_;
  std::vector<double> values_, means_;
  const double* row_ = nullptr;
};

/// Adds the estimated error of pixel `i`.
void add_error(const BlendedHalf& half0, const BlendedHalf& half1, std::size_t i,
               const std::array<std::array<double, 2>, 3>& references, RegionSums& region,
               DenoiseSums& sums) {
  double scaled = 0, first = 0, second = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto scale_of = [](double reference) {
      return 1 / (reference * reference + static_cast<double>(FilterParameters::kErrorFloor));
    };
    const double s0 = scale_of(references[c][0]), s1 = scale_of(references[c][1]);
    const double both = std::min(s0, s1);  // of what is subtracted
    const double d0 = half0.colour[c][i], d1 = half1.colour[c][i];
    const StreamPair &own = half0.raw, &other = half1.raw;
    const std::array<double, 2> e0 = {d0 - other.a[c][i], d0 - other.b[c][i]},
                                e1 = {d1 - own.a[c][i], d1 - own.b[c][i]};
    const double t0 = e0[0] * e0[1] * s0, t1 = e1[0] * e1[1] * s1;
    first += t0;
    second += t1;
    scaled += 0.5 * (t0 + t1) - 0.25 * ((d0 - d1) * (d0 - d1)) * both;

    const double root0 = std::sqrt(s0), root1 = std::sqrt(s1);
    RegionSums::Channel& channel = region.channels[c];
    for (std::size_t k = 0; k < 2; ++k) {
      channel.first[k] += e0[k] * root0;
      channel.second[k] += e1[k] * root1;
    }
    channel.between += (d0 - d1) * std::min(root0, root1);
    channel.first_noise += 0.5 * ((e0[0] - e0[1]) * (e0[0] - e0[1])) * s0;
    channel.second_noise += 0.5 * ((e1[0] - e1[1]) * (e1[0] - e1[1])) * s1;
  }
  const double magnitude = std::fabs(0.5 * (first + second));
  ++region.pixels;
  ++sums.pixels;
  sums.pixel_by_pixel.add({scaled, 0.5 * (first * first + second * second)});
  sums.magnitude += magnitude;
  sums.magnitude_squares += magnitude * magnitude;
}

}  // namespace

void add_errors(const BlendedHalf& first, const BlendedHalf& second, DenoiseSums& sums) {
  std::array<ReferenceValues, 3> references = {ReferenceValues(first, second, 0),
                                               ReferenceValues(first, second, 1),
                                               ReferenceValues(first, second, 2)};
  const auto width = static_cast<std::size_t>(first.width),
             height = static_cast<std::size_t>(first.height);
  RegionGrid regions(width - std::size_t{2} * kBlurMargin, height - std::size_t{2} * kBlurMargin);
  for (std::size_t row = kBlurMargin; row < height - kBlurMargin; ++row) {
    for (ReferenceValues& channel : references) channel.use_row(row * width);
    for (std::size_t x = kBlurMargin; x < width - kBlurMargin; ++x) {
      add_error(first, second, row * width + x,
                {references[0].at(x), references[1].at(x), references[2].at(x)},
                regions.at(x - kBlurMargin, row - kBlurMargin), sums);
    }
  }
  regions.add_to(sums.by_regions, sums.frame);
  for (std::size_t k = 0; k < first.is_raw_cell.size(); ++k) {
    ++sums.cells;
    sums.raw_cells += first.is_raw_cell[k] != 0 && second.is_raw_cell[k] != 0 ? 1 : 0;
  }
}

}  // namespace tessera::image
