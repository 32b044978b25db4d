#include "image/denoise/frame_denoiser.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "image/denoise/layers.h"

namespace tessera::image {
namespace {

constexpr std::size_t kReplicates = 4, kPerReplicate = kDenoisingChannels.size();
static_assert(kReplicates * kPerReplicate == kDenoiseInputs);

std::string channel_name(std::size_t replicate, std::size_t channel) {
  return absl::StrCat(kDenoisingPrefix, replicate, ".", kDenoisingChannels[channel]);
}

std::size_t position(const std::vector<ExrPlane>& planes, const std::string& name) {
  const auto found = std::find_if(planes.begin(), planes.end(),
                                  [&](const ExrPlane& plane) { return plane.name == name; });
  return static_cast<std::size_t>(found - planes.begin());
}

bool has_all(const std::vector<ExrPlane>& planes, const std::vector<std::string>& names) {
  return std::all_of(names.begin(), names.end(), [&](const std::string& name) {
    const std::size_t found = position(planes, name);
    return found < planes.size() && planes[found].type != ExrType::uint32;
  });
}

DenoiseFrame frame_of(std::int32_t width, std::int32_t height, double mean_luminance) {
  return {width, height, mean_luminance > 0 ? mean_luminance : 1};
}

std::size_t as_size(std::int32_t value) {
  return static_cast<std::size_t>(value);
}

}  // namespace

class FrameDenoiser::State {
 public:
  State(std::int32_t width, std::int32_t height, double mean_luminance,
        const std::vector<ExrPlane>& inputs, int threads, const AnimationInput* animation)
      : width_(width),
        height_(height),
        denoiser_(frame_of(width, height, mean_luminance), {0, 0, width, height}, threads,
                  animation) {
    for (std::size_t r = 0; r < kReplicates; ++r) {
      for (std::size_t c = 0; c < kPerReplicate; ++c) {
        inputs_.push_back(position(inputs, channel_name(r, c)));
      }
    }
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      if (inputs[i].name.rfind(kDenoisingPrefix, 0) == 0) continue;
      kept_.push_back(i);
      planes_.push_back({inputs[i].name, inputs[i].type, {}, {}});
    }
    for (std::size_t c = 0; c < 3; ++c) colour_[c] = position(planes_, std::string(1, "RGB"[c]));
    if (has_all(planes_, {"A"})) alpha_ = position(planes_, "A");
    const ExrType type = planes_[colour_[0]].type;
    raw_ = planes_.size();
    for (const char* name : {"raw.R", "raw.G", "raw.B"}) planes_.push_back({name, type, {}, {}});
    variance_ = planes_.size();
    for (const char* name : {"variance.R", "variance.G", "variance.B"}) {
      planes_.push_back({name, ExrType::float32, {}, {}});
    }
    albedo_ = add_feature({"albedo.R", "albedo.G", "albedo.B"}, type);
    normal_ = add_feature({"normal.X", "normal.Y", "normal.Z"}, type);
    rows_.resize(inputs_.size());
    waiting_ = planes_;
  }

  const std::vector<ExrPlane>& planes() const { return planes_; }
  const DenoiseSums& sums() const { return denoiser_.sums(); }

  absl::Status push(std::int32_t rows, const std::vector<ExrPlane>& inputs, const Sink& sink) {
    const std::size_t count = as_size(rows) * as_size(width_);
    for (std::size_t k = 0; k < inputs_.size(); ++k) {
      const std::vector<float>& from = inputs[inputs_[k]].values;
      rows_[k].insert(rows_[k].end(), from.begin(),
                      from.begin() + static_cast<std::ptrdiff_t>(count));
    }
    for (std::size_t k = 0; k < kept_.size(); ++k) {
      const ExrPlane& from = inputs[kept_[k]];
      ExrPlane& to = waiting_[k];
      const auto size = static_cast<std::ptrdiff_t>(count);
      if (from.type == ExrType::uint32) {
        to.words.insert(to.words.end(), from.words.begin(), from.words.begin() + size);
      } else {
        to.values.insert(to.values.end(), from.values.begin(), from.values.begin() + size);
      }
    }
    end_row_ += rows;
    while (next_row_ < height_) {
      if (end_row_ < denoiser_.input_end()) break;
      if (absl::Status status = emit(sink); !status.ok()) return status;
    }
    return absl::OkStatus();
  }

 private:
  static constexpr std::size_t kNone = ~std::size_t{0};

  /// Adds a layer unless the file has it; returns its first plane or kNone.
  std::size_t add_feature(std::initializer_list<const char*> names, ExrType type) {
    if (position(planes_, *names.begin()) < planes_.size()) return kNone;
    const std::size_t first = planes_.size();
    for (const char* name : names) planes_.push_back({name, type, {}, {}});
    return first;
  }

  /// Denoises the next rows and passes them on.
  absl::Status emit(const Sink& sink) {
    DenoiseRows input;
    input.first = first_row_;
    for (std::size_t k = 0; k < inputs_.size(); ++k) input.planes[k] = rows_[k].data();
    const DenoisedRows denoised = denoiser_.next(input);

    const std::size_t count = denoised.is_raw.size();
    std::vector<ExrPlane> output = planes_;
    for (std::size_t k = 0; k < kept_.size(); ++k) {
      move_front(waiting_[k].values, output[k].values, count);
      move_front(waiting_[k].words, output[k].words, count);
    }
    for (std::size_t c = 0; c < 3; ++c) output[raw_ + c].values = output[colour_[c]].values;
    put_denoised(denoised, output);
    put_variance(count, output);
    if (albedo_ != kNone) put_feature(0, albedo_, count, output);
    if (normal_ != kNone) put_feature(3, normal_, count, output);
    if (absl::Status status = sink(denoised.rows, output); !status.ok()) return status;
    next_row_ += denoised.rows;
    drop_rows(denoiser_.input_begin());
    return absl::OkStatus();
  }

  static void move_front(auto& from, auto& to, std::size_t count) {
    if (from.empty()) return;
    const auto size = static_cast<std::ptrdiff_t>(count);
    to.assign(from.begin(), from.begin() + size);
    from.erase(from.begin(), from.begin() + size);
  }

  void drop_rows(std::int32_t first_row) {
    const auto gone =
        static_cast<std::ptrdiff_t>(as_size(first_row - first_row_) * as_size(width_));
    for (std::vector<float>& plane : rows_) plane.erase(plane.begin(), plane.begin() + gone);
    first_row_ = first_row;
  }

  /// Replaces R, G, B, but for pixels that are left raw, and for those without coverage and light,
  /// which composite over others. A regression may go below 0, where only a raw value can be.
  void put_denoised(const DenoisedRows& denoised, std::vector<ExrPlane>& output) const {
    for (std::size_t i = 0; i < denoised.is_raw.size(); ++i) {
      if (denoised.is_raw[i] != 0 || is_empty(i, output)) continue;
      for (std::size_t c = 0; c < 3; ++c) {
        float& to = output[colour_[c]].values[i];
        to = std::max(denoised.rgb[c][i], std::min(to, 0.0f));
      }
    }
  }

  bool is_empty(std::size_t i, const std::vector<ExrPlane>& output) const {
    if (alpha_ == kNone || output[alpha_].values[i] != 0) return false;
    return std::all_of(colour_.begin(), colour_.end(),
                       [&](std::size_t plane) { return output[plane].values[i] == 0; });
  }

  /// Index in rows_ of the first value of the row to be passed on.
  std::size_t offset() const { return as_size(next_row_ - first_row_) * as_size(width_); }

  /// Variance of the raw mean, from the spread of the replicates.
  void put_variance(std::size_t count, std::vector<ExrPlane>& output) const {
    for (std::size_t c = 0; c < 3; ++c) {
      std::vector<float>& to = output[variance_ + c].values;
      to.resize(count);
      for (std::size_t i = 0; i < count; ++i) {
        double mean = 0, sum = 0;
        for (std::size_t r = 0; r < kReplicates; ++r) {
          mean += static_cast<double>(rows_[r * kPerReplicate + c][offset() + i]) / kReplicates;
        }
        for (std::size_t r = 0; r < kReplicates; ++r) {
          const double difference = rows_[r * kPerReplicate + c][offset() + i] - mean;
          sum += difference * difference;
        }
        to[i] = static_cast<float>(sum / (kReplicates * (kReplicates - 1)));
      }
    }
  }

  /// A feature's mean over the samples that hit something.
  void put_feature(std::size_t first, std::size_t to, std::size_t count,
                   std::vector<ExrPlane>& output) const {
    for (std::size_t c = 0; c < 3; ++c) {
      std::vector<float>& values = output[to + c].values;
      values.resize(count);
      for (std::size_t i = 0; i < count; ++i) {
        double sum = 0, hits = 0;
        for (std::size_t r = 0; r < kReplicates; ++r) {
          sum += rows_[r * kPerReplicate + 3 + first + c][offset() + i];
          hits += rows_[r * kPerReplicate + kPerReplicate - 1][offset() + i];
        }
        values[i] = hits > 0 ? static_cast<float>(sum / hits) : 0.0f;
      }
    }
  }

  const std::int32_t width_, height_;
  Denoiser denoiser_;
  std::vector<std::size_t> inputs_;  // positions of the denoising channels among the inputs
  std::vector<std::size_t> kept_;    // positions of the other channels
  std::vector<ExrPlane> planes_;     // of the output: the kept channels, then new ones
  std::array<std::size_t, 3> colour_{};
  std::size_t alpha_ = kNone, raw_ = 0, variance_ = 0, albedo_ = kNone, normal_ = kNone;
  std::vector<std::vector<float>> rows_;  // denoising channels of rows [first_row_, end_row_)
  std::vector<ExrPlane> waiting_;         // kept channels of rows [next_row_, end_row_)
  std::int32_t first_row_ = 0, next_row_ = 0, end_row_ = 0;
};

FrameDenoiser::FrameDenoiser(std::int32_t width, std::int32_t height, double mean_luminance,
                             const std::vector<ExrPlane>& inputs, int threads,
                             const AnimationInput* animation)
    : state_(std::make_unique<State>(width, height, mean_luminance, inputs, threads, animation)) {}

FrameDenoiser::~FrameDenoiser() = default;
FrameDenoiser::FrameDenoiser(FrameDenoiser&&) noexcept = default;

bool FrameDenoiser::has_layers(const std::vector<ExrPlane>& inputs) {
  std::vector<std::string> names = {"R", "G", "B"};
  for (std::size_t r = 0; r < kReplicates; ++r) {
    for (std::size_t c = 0; c < kPerReplicate; ++c) names.push_back(channel_name(r, c));
  }
  return has_all(inputs, names);
}

bool FrameDenoiser::has_motion(const std::vector<ExrPlane>& inputs) {
  return has_layers(inputs) && has_all(inputs, {kMotionChannels.begin(), kMotionChannels.end()});
}

const std::vector<ExrPlane>& FrameDenoiser::planes() const {
  return state_->planes();
}

absl::Status FrameDenoiser::push(std::int32_t rows, const std::vector<ExrPlane>& inputs,
                                 const Sink& sink) {
  return state_->push(rows, inputs, sink);
}

DenoisedError FrameDenoiser::error(double quantile) const {
  return denoised_error(state_->sums(), quantile);
}

AnimationFrame animation_frame(std::int32_t width, std::int32_t height, double mean_luminance,
                               const std::vector<ExrPlane>& inputs, int threads) {
  const auto values = [&](const std::string& name) {
    return inputs[position(inputs, name)].values.data();
  };
  AnimationFrame frame;
  frame.frame = frame_of(width, height, mean_luminance);
  for (std::size_t r = 0; r < kReplicates; ++r) {
    for (std::size_t c = 0; c < kPerReplicate; ++c)
      frame.rows.planes[r * kPerReplicate + c] = values(channel_name(r, c));
  }
  for (std::size_t k = 0; k < kMotionChannels.size(); ++k)
    frame.motion[k] = values(kMotionChannels[k]);
  find_guides(frame, threads);
  return frame;
}

}  // namespace tessera::image
