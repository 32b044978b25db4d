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
#include "worker/renderer/descriptor_reader.h"
#include "worker/render/frame_renderer.h"

namespace tessera::agent {

/// A job's frame, ready to render from.
struct LoadedFrame {
  contract::RenderSettings settings;
  contract::TileGrid grid;
  std::unique_ptr<const render::FrameRenderer> renderer;
};

/// The scenes a renderer process holds: parsed files by job, posed frames by (job, frame). What is
/// kept is the agent's decision; a frame that is forgotten lives on until its last unit is done,
/// which is why units and this table share it.
class LoadedFrames {
 public:
  /// `texel_bytes`: see DescriptorReader.
  LoadedFrames(render::TraceOptions tracing, std::int64_t texel_bytes)
      : tracing_(std::move(tracing)), texel_bytes_(texel_bytes) {}

  struct Outcome {
    double load_seconds = 0;   // parsing, decoding, posing
    double build_seconds = 0;  // structures and tables
  };

  /// Loads a frame; `descriptors` are those of the command's manifest. One call at a time.
  ///
  /// Errors: those of the loader, naming file, element and fault.
  absl::StatusOr<Outcome> load(const v1::LoadScene& command, std::vector<Descriptor> descriptors,
                               const render::ParallelFor& parallel_for);

  /// The frame; null unless it is loaded. Any thread.
  std::shared_ptr<const LoadedFrame> find(const std::string& job_id, std::int32_t frame);

  /// Any thread.
  void forget(const v1::UnloadScene& command);

 private:
  /// The reader must outlive the file: it lends it the bytes.
  struct JobScene {
    std::unique_ptr<DescriptorReader> reader;
    std::unique_ptr<render::SceneFile> file;
  };

  absl::StatusOr<std::shared_ptr<JobScene>> job_scene(const v1::LoadScene& command,
                                                      const contract::RenderSettings& settings,
                                                      std::vector<Descriptor> descriptors);

  /// Some loaded frame of the job, with which another can share; null if there is none.
  std::shared_ptr<const LoadedFrame> any_frame(const std::string& job_id);

  const render::TraceOptions tracing_;
  const std::int64_t texel_bytes_;
  std::mutex mutex_;  // guards what follows
  std::map<std::string, std::shared_ptr<JobScene>> jobs_;
  std::map<std::pair<std::string, std::int32_t>, std::shared_ptr<const LoadedFrame>> frames_;
};

}  // namespace tessera::agent
