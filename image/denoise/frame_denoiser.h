#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "image/denoise/denoiser.h"
#include "image/exr/exr_file.h"

namespace tessera::image {

/// Denoises a frame that arrives in bands of rows: replaces the channels of layers.h by the raw
/// image, its variance, albedo and normal, and R, G, B by the denoised image. Other channels pass
/// unchanged. Memory is that of about 200 rows of all channels, whatever the frame's height.
class FrameDenoiser {
 public:
  /// Writes the next rows of the output, whose planes are as planes().
  using Sink = std::function<absl::Status(std::int32_t rows, const std::vector<ExrPlane>& planes)>;

  /// `mean_luminance` is m of the frame, in the scale of R, G, B; 0 if it is unknown. `inputs` are
  /// the channels of the frame. `threads` changes the time only. With `animation`, the neighbours
  /// of the frame count too; it may be null. Requires has_layers(inputs).
  FrameDenoiser(std::int32_t width, std::int32_t height, double mean_luminance,
                const std::vector<ExrPlane>& inputs, int threads,
                const AnimationInput* animation = nullptr);
  ~FrameDenoiser();
  FrameDenoiser(FrameDenoiser&&) noexcept;
  FrameDenoiser(const FrameDenoiser&) = delete;
  FrameDenoiser& operator=(const FrameDenoiser&) = delete;

  /// Whether R, G, B and all channels of layers.h are among `inputs`.
  static bool has_layers(const std::vector<ExrPlane>& inputs);
  /// Whether all of them and kMotionChannels are among `inputs`.
  static bool has_motion(const std::vector<ExrPlane>& inputs);

  /// The channels of the output, without pixels.
  const std::vector<ExrPlane>& planes() const;
  /// Takes the next `rows` rows of all inputs and passes on the rows that are finished. Errors: the
  /// sink's.
  absl::Status push(std::int32_t rows, const std::vector<ExrPlane>& inputs, const Sink& sink);
  /// Error of the rows passed on, as denoised_error(); tiles in order, row by row from the top.
  DenoisedError error(double quantile = kNormalQuantile95) const;

 private:
  class State;
  std::unique_ptr<State> state_;
};

/// A frame of an animation, with its guides. `inputs` are all rows of its channels and must outlive
/// it. Otherwise as for FrameDenoiser. Requires FrameDenoiser::has_motion(inputs).
AnimationFrame animation_frame(std::int32_t width, std::int32_t height, double mean_luminance,
                               const std::vector<ExrPlane>& inputs, int threads);

}  // namespace tessera::image
