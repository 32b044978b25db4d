#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "absl/status/statusor.h"
#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/render_settings.h"
#include "worker/accel/scene_accel.h"
#include "worker/scene/scene.h"

namespace tessera::render {

class PathObserver;

/// One frame of a job, ready to render any of its units. Immutable after creation and thread-safe.
class FrameRenderer {
 public:
  /// Takes the scene and builds acceleration structures and light sampling tables, using
  /// `parallel_for`. Shares the structures of unchanged meshes with `before`, another frame of the
  /// job. Pixels do not depend on `tracing`.
  ///
  /// Errors: InvalidArgument if scene or settings cannot be rendered.
  static absl::StatusOr<std::unique_ptr<FrameRenderer>> create(
      Scene scene, const contract::RenderSettings& settings, std::int32_t frame,
      const ParallelFor& parallel_for, const FrameRenderer* before = nullptr,
      const TraceOptions& tracing = {});
  virtual ~FrameRenderer() = default;

  /// Renders one unit: the samples of `pass` over the pixels of `rect`. The block is a function of
  /// the scene, the settings, the frame, `rect` and `pass` alone. `pass_index` 0 adds the layers of
  /// sample 0. `parallel_for` splits the unit's pixels, without changing any bit; pass sequential()
  /// if units already keep all cores busy. Adds the work of all its threads to
  /// thread_traversal_counts() of the calling thread.
  virtual contract::FilmBlock render(const contract::PixelRect& rect, const contract::Pass& pass,
                                     std::int32_t pass_index,
                                     const ParallelFor& parallel_for) const = 0;

  /// One sample of a pixel, before --clamp.
  struct Sample {
    std::array<float, 3> radiance{};
    float alpha = 1;
  };
  /// Traces sample `sample` of the pixel (x, y), in full-frame coordinates, and reports its path to
  /// `observer`. Returns exactly the values that render() adds for this sample.
  virtual Sample trace_sample(std::int32_t x, std::int32_t y, std::int32_t sample,
                              PathObserver& observer) const = 0;

  struct Timings {
    double accel_build_seconds = 0;
    std::int64_t memory_bytes = 0;  // scene, acceleration structures, tables
  };
  virtual Timings timings() const = 0;
  virtual const SceneAccel& accel() const = 0;
};

}  // namespace tessera::render
