#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "worker/agent/server/job_fetcher.h"
#include "worker/agent/server/job_log.h"
#include "worker/agent/supervisor/renderer_process.h"
#include "worker/agent/units/event_loop.h"
#include "worker/agent/units/unit_log.h"
#include "worker/agent/units/unit_queue.h"

namespace tessera::agent {

struct RendererSupervisorOptions {
  std::string program = "/proc/self/exe";  // executable of the renderer
  std::vector<std::string> arguments;      // the renderer's arguments
  int thread_count = 1;
  std::chrono::seconds unit_timeout{3600};                 // for a unit, and for loading a scene
  int loaded_frames = 2;                                   // maximum number of loaded frames
  std::function<void(std::string& block)> block_rendered;  // FaultHooks::block_rendered
  JobLog log;
};

/// Supervises the renderer process: loads the scenes of leased units, keeps its threads busy,
/// restarts it after a crash and reports the unit at fault.
///
/// All calls are on the agent's thread; events of other threads arrive through the event loop.
class RendererSupervisor {
 public:
  /// Cost of a finished unit.
  struct Rendered {
    double seconds = 0;  // wall time on its thread
    double cpu_seconds = 0;
    std::int64_t block_bytes = 0;
  };
  struct Callbacks {
    std::function<void(const std::string& job_id)> fetch_job;  // ends with job_fetched()
    std::function<void(v1::UnitFailure)> failed;
    /// The server lacks their job or a file of it.
    std::function<void(std::vector<UnitKey>)> units_returned;
    std::function<void(v1::SceneLoaded)> scene_loaded;
    std::function<void(const Rendered&)> unit_finished;  // the queue has its block
    std::function<void()> renderer_died;
    std::function<void(absl::Status)> failed_for_good;  // no renderer can be started
  };

  /// `first`: a renderer that is already running; later ones are started by this object. All
  /// references must outlive this object.
  RendererSupervisor(RendererSupervisorOptions options, std::optional<RendererProcess::Child> first,
                     UnitQueue& queue, UnitLog& log, EventLoop& event_loop, Callbacks callbacks);

  /// Starts the renderer if there is none and the restart delay is over, kills it if it hangs,
  /// loads scenes and hands out units. Call after every change and at least once per second.
  void pump(Time now);
  void job_fetched(const std::string& job_id, absl::StatusOr<JobInputs> inputs);
  void job_ended(const std::string& job_id);

  /// The renderer's announcement; null before it is received.
  const v1::RendererReady* ready() const { return ready_ ? &*ready_ : nullptr; }
  /// Smoothed wall time of a unit on its thread, seconds; 0 before the first unit.
  double unit_seconds() const { return unit_seconds_; }
  /// Size of the largest block of the current jobs, bytes.
  std::int64_t block_bytes() const { return block_bytes_; }
  /// Resident memory of the renderer, bytes.
  std::int64_t renderer_rss_bytes() const;

 private:
  using FrameKey = std::pair<std::string, std::int32_t>;
  struct Job {
    std::optional<JobInputs> inputs;  // absent until they are fetched
    absl::Status error;               // reason why fetching failed
  };
  struct Frame {
    bool loaded = false;
    absl::Status error;  // reason why loading failed
    Time used;
    bool is_loading() const { return !loaded && error.ok(); }
  };

  void start_renderer(Time now);
  void on_event(std::int64_t generation, v1::RendererEvent event);
  void on_death(std::int64_t generation, const RendererProcess::Death& death);
  void attribute_crash(const RendererProcess::Death& death);
  std::vector<UnitKey> possible_causes() const;
  void on_scene(const v1::LoadSceneResult& outcome);
  void on_unit(v1::RenderUnitResult outcome);
  void log_unit(LogLevel level, const UnitKey& unit, const std::string& text);
  void fail(const UnitKey& key, const std::string& message, const std::string& log_tail,
            absl::StatusCode code);
  bool kill_hung(Time now);
  bool is_renderer_silent(Time now);
  bool render_suspects(Time now);
  bool prepare(const UnitKey& key, Time now);
  bool prepare_job(const UnitKey& key);
  bool load_frame(const FrameKey& key, const JobInputs& inputs, Time now);
  bool make_room(const FrameKey& wanted);
  void hand_out(const UnitKey& key);
  std::size_t handed_out_limit() const;

  const RendererSupervisorOptions options_;
  UnitQueue& queue_;
  UnitLog& log_;
  EventLoop& event_loop_;
  const Callbacks callbacks_;

  std::optional<RendererProcess::Child> first_;
  std::unique_ptr<RendererProcess> renderer_;
  std::int64_t generation_ = 0;  // number of renderers started; events of earlier ones are ignored
  std::optional<v1::RendererReady> ready_;
  Time start_at_{};       // earliest time of the next start
  Time last_event_at_{};  // last event of the renderer, or last time it was idle
  int consecutive_deaths_ = 0;

  std::map<std::string, Job> jobs_;
  std::map<FrameKey, Frame> frames_;       // loaded, loading or failed
  std::map<UnitKey, Time> running_units_;  // units being rendered, with their start
  std::optional<UnitKey> hung_;            // unit for which the renderer was killed
  std::set<UnitKey> suspect_units_;        // may have crashed a renderer: rendered alone
  double unit_seconds_ = 0;
  std::int64_t block_bytes_ = 0;
};

}  // namespace tessera::agent
