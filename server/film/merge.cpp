#include "server/film/merge.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "contract/index.h"
#include "server/film/largest_values.h"

namespace tessera::server {
namespace {

using contract::kReplicates;

constexpr int kChannels = 3;
constexpr int kRgbPerPixel = kReplicates * kChannels;

/// Returns the nearest float, clamped to the largest finite one, which a mean of few samples may
/// exceed.
float to_float(double value) {
  constexpr double kLargest = std::numeric_limits<float>::max();
  if (value > kLargest) value = kLargest;
  if (value < -kLargest) value = -kLargest;
  return static_cast<float>(value);
}

template <typename Sum>
void add_plane(const std::vector<float>& plane, std::vector<Sum>& sums) {
  for (std::size_t i = 0; i < plane.size(); ++i) sums[i] += plane[i];
}

/// Returns the number of samples [first, first + count) in replicate `r`.
std::int32_t samples_of_replicate(std::int32_t first, std::int32_t count, int r) {
  const auto below = [r](std::int32_t end) { return (end + kReplicates - 1 - r) / kReplicates; };
  return below(first + count) - below(first);
}

/// Sums over the replicates of one channel: (x_r − x̄)², plain and divided by the two denominators,
/// each ÷ R(R−1).
struct ChannelError {
  double squared = 0, relative = 0, scaled = 0, cautious = 0;
};

/// Returns the value that stands for the exact one in the denominator of a replicate's term: the
/// mean of the other replicates, or, where the darkest of them is far below it, that one. Their
/// mean rests on a few bright samples then, and may be as wrong as the pixel. Not the mean of all:
/// a firefly would be divided by itself.
constexpr double kRareRatio = 32;
double divisor(double others_mean, double darkest_other) {
  return darkest_other * kRareRatio < others_mean ? darkest_other : others_mean;
}

/// Requires at least two means.
ChannelError channel_error(std::span<const double> means, double floor_scaled) {
  constexpr double kFloorRelative = 0.01;
  const auto n = static_cast<double>(means.size());
  double mean = 0;
  for (const double value : means) mean += value;
  mean /= n;
  ChannelError sums;
  for (std::size_t i = 0; i < means.size(); ++i) {
    const double difference = means[i] - mean;
    const double square = difference * difference;
    if (square == 0) continue;
    double others = 0, darkest = std::numeric_limits<double>::max();
    for (std::size_t k = 0; k < means.size(); ++k) {
      if (k == i) continue;
      others += means[k];
      darkest = std::min(darkest, means[k]);
    }
    others /= n - 1;
    const double base = divisor(others, darkest);
    sums.squared += square;
    sums.relative += square / (others * others + kFloorRelative);
    if (floor_scaled <= 0) continue;
    sums.scaled += square / (others * others + floor_scaled);
    sums.cautious += square / (base * base + floor_scaled);
  }
  const double pairs = n * (n - 1);
  return {sums.squared / pairs, sums.relative / pairs, sums.scaled / pairs, sums.cautious / pairs};
}

/// The same for one channel of kLanes pixels at once, with all samples kept. Inner loops are over
/// pixels, so that compilers vectorise them. Adds in the order of channel_error.
constexpr int kLanes = 8;
using Lanes = std::array<double, kLanes>;

struct LaneErrors {
  Lanes squared{}, relative{}, scaled{}, cautious{};
};

void add_lane_errors(const std::array<Lanes, kReplicates>& x, double floor_scaled,
                     LaneErrors& sums) {
  constexpr double kFloorRelative = 0.01;
  constexpr double kPairs = kReplicates * (kReplicates - 1);
  const double floor = floor_scaled > 0 ? floor_scaled : 1;
  const double weight = floor_scaled > 0 ? 1 / kPairs : 0;
  Lanes mean{};
  for (const Lanes& replicate : x) {
    for (std::size_t l = 0; l < kLanes; ++l) mean[l] += replicate[l];
  }
  for (double& value : mean) value /= kReplicates;
  for (std::size_t r = 0; r < kReplicates; ++r) {
    Lanes others{}, darkest = x[r == 0 ? 1 : 0];
    for (std::size_t k = 0; k < kReplicates; ++k) {
      if (k == r) continue;
      for (std::size_t l = 0; l < kLanes; ++l) {
        others[l] += x[k][l];
        darkest[l] = std::min(darkest[l], x[k][l]);
      }
    }
    for (std::size_t l = 0; l < kLanes; ++l) {
      const double difference = x[r][l] - mean[l], square = difference * difference;
      const double other = others[l] * (1.0 / (kReplicates - 1));
      const double base = divisor(other, darkest[l]);
      sums.squared[l] += square * (1 / kPairs);
      sums.relative[l] += square / (other * other + kFloorRelative) * (1 / kPairs);
      sums.scaled[l] += square / (other * other + floor) * weight;
      sums.cautious[l] += square / (base * base + floor) * weight;
    }
  }
}

/// Errors of kLanes pixels starting at `rgb`, with all samples kept.
LaneErrors lane_errors(const double* rgb, std::int32_t sample_count, double floor_scaled) {
  const double per_sample = static_cast<double>(kReplicates) / sample_count;
  LaneErrors errors;
  for (std::size_t channel = 0; channel < kChannels; ++channel) {
    std::array<Lanes, kReplicates> means;
    const double* from = rgb + channel;
    for (std::size_t l = 0; l < kLanes; ++l) {
      for (std::size_t r = 0; r < kReplicates; ++r) {
        means[r][l] = from[l * kRgbPerPixel + r * kChannels] * per_sample;
      }
    }
    add_lane_errors(means, floor_scaled, errors);
  }
  return errors;
}

}  // namespace

TileSum::TileSum(std::int32_t width, std::int32_t height, std::uint32_t aovs)
    : width_(width), height_(height), aovs_(aovs) {
  const std::size_t pixels = contract::as_index(pixel_count());
  rgb_.resize(kRgbPerPixel * pixels);
  alpha_.resize(pixels);
  if (aovs & contract::kAovAlbedo) albedo_.resize(3 * pixels);
  if (aovs & contract::kAovNormal) normal_.resize(3 * pixels);
  if (aovs & (contract::kAovAlbedo | contract::kAovNormal)) hits_.resize(pixels);
  if (aovs & contract::kAovDenoising) {
    features_.resize(std::size_t{kReplicates} * contract::kFeatures * pixels);
  }
  if (aovs & contract::kAovTraversalCost) traversal_cost_.resize(3 * pixels);
  if (aovs & contract::kAovDepth) first_sample_.depth.resize(pixels);
  if (aovs & contract::kAovPosition) first_sample_.position.resize(3 * pixels);
  if (aovs & contract::kAovMotion) first_sample_.motion.resize(4 * pixels);
  if (aovs & contract::kAovIds) first_sample_.ids.resize(3 * pixels);
}

absl::Status TileSum::add(const contract::FilmBlock& block, const contract::Pass& pass) {
  const contract::FilmBlockShape expected{width_, height_, aovs_, pass_count_ == 0};
  if (block.shape != expected) {
    return absl::InvalidArgumentError(
        absl::StrCat("film: a block of ", block.shape.width, "x", block.shape.height, " pixels",
                     block.shape.first_pass ? ", pass 0," : "", " does not fit a tile of ", width_,
                     "x", height_, " after ", pass_count_, " passes"));
  }
  if (pass.first_sample != sample_count_ || pass.sample_count < 1) {
    return absl::InvalidArgumentError(absl::StrCat("film: a pass of samples [", pass.first_sample,
                                                   ", ", pass.end(), ") does not follow on sample ",
                                                   sample_count_));
  }
  add_plane(block.rgb, rgb_);
  add_plane(block.alpha, alpha_);
  add_plane(block.albedo, albedo_);
  add_plane(block.normal, normal_);
  add_plane(block.hits, hits_);
  add_plane(block.features, features_);
  add_plane(block.traversal_cost, traversal_cost_);
  if (pass_count_ == 0) {
    first_sample_.depth = block.depth;
    first_sample_.position = block.position;
    first_sample_.motion = block.motion;
    first_sample_.ids = block.ids;
  }
  if (!block.dropped.empty() && dropped_.empty()) {
    dropped_.resize(kReplicates * contract::as_index(pixel_count()));
  }
  for (const contract::DroppedSamples& entry : block.dropped) {
    dropped_[std::size_t{entry.pixel} * kReplicates + entry.replicate] +=
        static_cast<std::int32_t>(entry.count);
    losses_.dropped_count += entry.count;
  }
  losses_.clamped_energy += block.clamped_energy;
  losses_.truncated_energy += block.truncated_energy;
  losses_.transparency_limit_count += block.transparency_limit_count;
  sample_count_ += pass.sample_count;
  ++pass_count_;
  measured_.reset();
  return absl::OkStatus();
}

std::int64_t TileSum::bytes() const {
  const std::size_t doubles = rgb_.size() + alpha_.size() + albedo_.size() + normal_.size() +
                              hits_.size() + features_.size() + traversal_cost_.size() +
                              (measured_ ? measured_->largest.size() : 0);
  const std::size_t words = first_sample_.depth.size() + first_sample_.position.size() +
                            first_sample_.motion.size() + first_sample_.ids.size() +
                            dropped_.size();
  return static_cast<std::int64_t>(sizeof *this + 8 * doubles + 4 * words);
}

std::int32_t TileSum::kept(std::int64_t pixel, int r) const {
  const std::int32_t scheduled = samples_of_replicate(0, sample_count_, r);
  return dropped_.empty() ? scheduled
                          : scheduled - dropped_[contract::as_index(pixel * kReplicates + r)];
}

std::int32_t TileSum::kept(std::int64_t pixel) const {
  std::int32_t count = sample_count_;
  if (dropped_.empty()) return count;
  for (int r = 0; r < kReplicates; ++r)
    count -= dropped_[contract::as_index(pixel * kReplicates + r)];
  return count;
}

TileSum::ReplicateMeans TileSum::replicate_means(std::int64_t pixel, int channel) const {
  ReplicateMeans means;
  for (int r = 0; r < kReplicates; ++r) {
    const std::int32_t count = kept(pixel, r);
    if (count <= 0) continue;
    means.value[means.count++] =
        rgb_[contract::as_index(pixel * kRgbPerPixel + std::int64_t{kChannels} * r + channel)] /
        count;
  }
  return means;
}

void TileSum::rgba(std::int64_t pixel, std::span<float, 4> out) const {
  const std::int32_t count = kept(pixel);
  if (count <= 0) {
    for (float& value : out) value = 0;
    return;
  }
  const double* sums = &rgb_[contract::as_index(pixel * kRgbPerPixel)];
  for (int channel = 0; channel < kChannels; ++channel) {
    double sum = 0;
    for (int r = 0; r < kReplicates; ++r) sum += sums[kChannels * r + channel];
    out[contract::as_index(channel)] = to_float(sum / count);
  }
  out[3] = to_float(alpha_[contract::as_index(pixel)] / count);
}

void TileSum::standard_error(std::int64_t pixel, std::span<float, 3> out) const {
  for (int channel = 0; channel < kChannels; ++channel) {
    const ReplicateMeans means = replicate_means(pixel, channel);
    out[contract::as_index(channel)] =
        means.count < 2
            ? 0.0f
            : to_float(std::sqrt(
                  channel_error({means.value, contract::as_index(means.count)}, 0).squared));
  }
}

void TileSum::over_hits(const std::vector<double>& sums, std::int64_t pixel,
                        std::span<float, 3> out) const {
  const double hits = hits_[contract::as_index(pixel)];
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = hits > 0 ? to_float(sums[3 * contract::as_index(pixel) + k] / hits) : 0.0f;
  }
}

void TileSum::albedo(std::int64_t pixel, std::span<float, 3> out) const {
  over_hits(albedo_, pixel, out);
}

void TileSum::normal(std::int64_t pixel, std::span<float, 3> out) const {
  over_hits(normal_, pixel, out);
}

void TileSum::traversal_cost(std::int64_t pixel, std::span<float, 3> out) const {
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = to_float(traversal_cost_[3 * contract::as_index(pixel) + k] / sample_count_);
  }
}

TileSum::DenoisingValues TileSum::denoising_values(std::int64_t pixel) const {
  DenoisingValues values;
  for (std::size_t r = 0; r < kReplicates; ++r) {
    const std::int32_t count = kept(pixel, static_cast<int>(r));
    if (count <= 0) continue;
    const std::size_t at = contract::as_index(pixel) * kReplicates + r;
    for (std::size_t c = 0; c < 3; ++c) values.rgb[r][c] = to_float(rgb_[3 * at + c] / count);
    const double* sums = &features_[contract::kFeatures * at];
    const double hits = sums[7];
    for (std::size_t k = 0; k < contract::kFeatures; ++k) {
      values.features[r][k] = to_float(sums[k] / count);
    }
    values.features[r][6] = hits > 0 ? to_float(sums[6] / hits) : 0.0f;
  }
  return values;
}

double TileSum::luminance_sum() const {
  double total = 0;
  for (std::int64_t pixel = 0; pixel < pixel_count(); ++pixel) {
    const std::int32_t count = kept(pixel);
    if (count <= 0) continue;
    double sum[kChannels] = {};
    for (int r = 0; r < kReplicates; ++r) {
      for (int channel = 0; channel < kChannels; ++channel) {
        sum[channel] +=
            rgb_[contract::as_index(pixel * kRgbPerPixel + std::int64_t{kChannels} * r + channel)];
      }
    }
    total += (0.2126 * sum[0] + 0.7152 * sum[1] + 0.0722 * sum[2]) / count;
  }
  return total;
}

ErrorSums TileSum::error_sums(double mean_luminance, std::vector<double>* per_pixel) const {
  const double floor_scaled = 0.01 * mean_luminance * mean_luminance;
  ErrorSums sums;
  sums.pixels = pixel_count();
  const auto finish_pixel = [&](double scaled, double cautious) {
    sums.scaled += scaled;
    sums.cautious += cautious;
    sums.cautious_squares += cautious * cautious;
    if (per_pixel != nullptr) per_pixel->push_back(scaled);
  };
  std::int64_t pixel = 0;
  if (dropped_.empty() && sample_count_ > 0 && sample_count_ % kReplicates == 0) {
    for (; pixel + kLanes <= pixel_count(); pixel += kLanes) {
      const LaneErrors lanes =
          lane_errors(&rgb_[contract::as_index(pixel * kRgbPerPixel)], sample_count_, floor_scaled);
      for (std::size_t l = 0; l < kLanes; ++l) {
        sums.squared += lanes.squared[l];
        sums.relative += lanes.relative[l];
        finish_pixel(lanes.scaled[l], lanes.cautious[l]);
      }
    }
  }
  for (; pixel < pixel_count(); ++pixel) {
    double scaled = 0, cautious = 0;
    for (int channel = 0; channel < kChannels; ++channel) {
      const ReplicateMeans means = replicate_means(pixel, channel);
      if (means.count < 2) continue;
      const ChannelError error =
          channel_error({means.value, contract::as_index(means.count)}, floor_scaled);
      sums.squared += error.squared;
      sums.relative += error.relative;
      scaled += error.scaled;
      cautious += error.cautious;
    }
    finish_pixel(scaled, cautious);
  }
  return sums;
}

const ErrorSums& TileSum::measure(double mean_luminance) {
  std::vector<double> per_pixel;
  per_pixel.reserve(contract::as_index(pixel_count()));
  measured_ = Measured{mean_luminance, error_sums(mean_luminance, &per_pixel), {}};
  LargestValues largest(Measured::kLargest);
  for (const double value : per_pixel) largest.add(value);
  measured_->largest = largest.values();
  return measured_->sums;
}

void TrueSums::add(const TrueSums& other) {
  squared += other.squared;
  relative += other.relative;
  scaled += other.scaled;
}

TrueSums TileSum::true_sums(std::span<const float> reference, double mean_luminance) const {
  TrueSums sums;
  const double floor_scaled = 0.01 * mean_luminance * mean_luminance;
  for (std::int64_t pixel = 0; pixel < pixel_count(); ++pixel) {
    float mean[4];
    rgba(pixel, mean);
    for (std::size_t channel = 0; channel < std::size_t{kChannels}; ++channel) {
      const double ref = reference[4 * contract::as_index(pixel) + channel];
      const double difference = mean[channel] - ref, square = difference * difference;
      sums.squared += square;
      sums.relative += square / (ref * ref + 0.01);
      if (mean_luminance > 0) sums.scaled += square / (ref * ref + floor_scaled);
    }
  }
  return sums;
}

}  // namespace tessera::server
