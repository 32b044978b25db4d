#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "contract/tile_grid.h"
#include "tessera/v1/renderer.pb.h"
#include "worker/render/frame_renderer.h"
#include "worker/renderer/descriptor_reader.h"

namespace tessera::agent {

/// A frame of a job, ready to render.
struct LoadedFrame {
  contract::RenderSettings settings;
  contract::TileGrid grid;
  std::unique_ptr<const render::FrameRenderer> renderer;
};

/// Scenes of a renderer process: parsed files by job, posed frames by (job, frame). The agent
/// decides what to load and unload. An unloaded frame lives until its last unit is done, so units
/// and this table share ownership.
class LoadedFrames {
 public:
  /// `memory`: of each scene.
  LoadedFrames(render::Isa isa, const SceneMemory& memory) : isa_(isa), memory_(memory) {}

  struct Outcome {
    double load_seconds = 0;   // parsing, decoding, posing
    double build_seconds = 0;  // acceleration structures and sampling tables
    double accelerator_build_seconds = 0;
    std::int64_t accelerator_bytes = 0;
  };

  /// Loads a frame. `descriptors`: as for DescriptorReader. One call at a time.
  ///
  /// Errors: those of the loader, naming file, element and fault.
  absl::StatusOr<Outcome> load(const v1::LoadScene& command, std::vector<Descriptor> descriptors,
                               const render::ParallelFor& parallel_for);

  /// Returns a frame; null if it is not loaded. Thread-safe.
  std::shared_ptr<const LoadedFrame> find(const std::string& job_id, std::int32_t frame);

  /// Removes a frame, or all frames of a job. Thread-safe.
  void unload(const v1::UnloadScene& command);

 private:
  /// The reader must outlive the file, which refers to its bytes.
  struct JobScene {
    std::unique_ptr<DescriptorReader> reader;
    std::unique_ptr<render::SceneFile> file;
  };

  absl::StatusOr<std::shared_ptr<JobScene>> job_scene(const v1::LoadScene& command,
                                                      const contract::RenderSettings& settings,
                                                      std::vector<Descriptor> descriptors);

  /// Returns a loaded frame of the job, whose structures another frame can share; null if there is
  /// none.
  std::shared_ptr<const LoadedFrame> any_frame(const std::string& job_id);

  const render::Isa isa_;
  const SceneMemory memory_;
  std::mutex mutex_;  // guards what follows
  std::map<std::string, std::shared_ptr<JobScene>> jobs_;
  std::map<std::pair<std::string, std::int32_t>, std::shared_ptr<const LoadedFrame>> frames_;
};

}  // namespace tessera::agent
