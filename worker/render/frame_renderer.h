#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/render_settings.h"
#include "worker/accel/scene_accel.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// One frame of a job, ready to render any of its units. Immutable once made: any number of
/// threads may render from it at once.
class FrameRenderer {
 public:
  /// Takes the scene, builds acceleration structures and light tables, using `parallel_for`. What
  /// another frame of the job, `before`, has of the same meshes is shared with it. Pixels do not
  /// depend on `tracing`.
  ///
  /// Errors: InvalidArgument naming what in scene or settings cannot be rendered.
  static absl::StatusOr<std::unique_ptr<FrameRenderer>> create(
      Scene scene, const contract::RenderSettings& settings, std::int32_t frame,
      const ParallelFor& parallel_for, const FrameRenderer* before = nullptr,
      const TraceOptions& tracing = {});
  virtual ~FrameRenderer() = default;

  /// The block of one unit: the samples of `pass` over the pixels of `rect`. A function of the
  /// scene, the settings, the frame, `rect` and `pass` alone. `pass_index` 0 adds the sample-0
  /// layers. `parallel_for` splits the unit's pixels; pass sequential() where units already keep
  /// every core busy. Pixels are independent: the split never changes bits.
  virtual contract::FilmBlock render(const contract::PixelRect& rect, const contract::Pass& pass,
                                     std::int32_t pass_index,
                                     const ParallelFor& parallel_for) const = 0;

  struct Timings {
    double accel_build_seconds = 0;
    std::int64_t memory_bytes = 0;  // scene, structures, tables
  };
  virtual Timings timings() const = 0;
  virtual const SceneAccel& accel() const = 0;
};

/// A ParallelFor that runs its body on the calling thread, in order.
ParallelFor sequential();

}  // namespace tessera::render
