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
#include "worker/agent/units/event_loop.h"
#include "worker/agent/supervisor/renderer_process.h"
#include "worker/agent/units/unit_log.h"
#include "worker/agent/units/unit_queue.h"

namespace tessera::agent {

struct RenderDeskOptions {
  std::string program = "/proc/self/exe";  // what is started as the renderer
  std::vector<std::string> arguments;      // its arguments
  int thread_count = 1;
  std::chrono::seconds unit_timeout{3600};  // a unit, or scene, that takes longer hangs
  int loaded_frames = 2;                    // at most, at once
  int lie_every = 0;  // fault injection: a bit of every so many blocks; 0: none
  JobLog log;
};

/// Feeds the renderer process: sees to it that the scenes of leased units are there and loaded,
/// that every thread has a unit, and that a renderer that dies is started again and the unit it
/// died of reported.
///
/// Lives on the agent's thread; what happens elsewhere comes through the mailbox.
class RendererSupervisor {
 public:
  /// What a finished unit took.
  struct Rendered {
    double seconds = 0;  // wall time on its thread
    double cpu_seconds = 0;
    std::int64_t block_bytes = 0;
  };
  /// Where the desk's news go.
  struct Callbacks {
    std::function<void(const std::string& job_id)> want_job;  // answer with job_fetched()
    std::function<void(v1::UnitFailure)> failed;
    std::function<void(std::vector<UnitKey>)> given_up;  // units of a job that is gone
    std::function<void(v1::SceneLoaded)> scene_loaded;
    std::function<void(const Rendered&)> unit_finished;  // its block is in the queue
    std::function<void()> renderer_died;
    std::function<void(absl::Status)> broken;  // no renderer can be had at all
  };

  /// All references must outlive the desk.
  /// `first`: a renderer that has been started already; later ones are started here.
  RendererSupervisor(RenderDeskOptions options, std::optional<RendererProcess::Child> first,
             UnitQueue& queue, UnitLog& log, EventLoop& mailbox, Callbacks outlet);

  /// Starts the renderer if there is none and it is time to; kills one that hangs; loads scenes and
  /// hands out units. Call after every change and at least once a second.
  void pump(Time now);
  void job_fetched(const std::string& job_id, absl::StatusOr<JobInputs> files);
  void job_ended(const std::string& job_id);

  /// What the renderer said of itself; nullptr before it has.
  const v1::RendererReady* ready() const { return ready_ ? &*ready_ : nullptr; }
  /// Wall time of a unit on its thread, smoothed; 0: none finished yet.
  double unit_seconds() const { return unit_seconds_; }
  /// The largest block of the jobs at hand.
  std::int64_t block_bytes() const { return block_bytes_; }
  /// Resident memory of the renderer.
  std::int64_t renderer_rss_bytes() const;

 private:
  using FrameKey = std::pair<std::string, std::int32_t>;
  struct Job {
    std::optional<JobInputs> files;  // absent while they are fetched
    absl::Status error;             // why they cannot be
  };
  struct Frame {
    bool loaded = false;
    std::string error;  // what is wrong with the scene
    Time used;
  };

  void start_renderer(Time now);
  void on_event(std::int64_t generation, v1::RendererEvent event);
  void on_death(std::int64_t generation, const RendererProcess::Death& death);
  void attribute_crash(const RendererProcess::Death& death);
  std::vector<UnitKey> possible_causes() const;
  void on_scene(const v1::LoadSceneResult& outcome);
  void on_unit(v1::RenderUnitResult outcome);
  void say(LogLevel level, const UnitKey& unit, const std::string& what);
  void fail(const UnitKey& key, const std::string& message, const std::string& log_tail,
            bool bad_scene);
  bool kill_hung(Time now);
  bool is_renderer_silent(Time now);
  bool render_suspects(Time now);
  bool prepare(const UnitKey& key, Time now);
  bool prepare_job(const UnitKey& key);
  bool load_frame(const FrameKey& key, const JobInputs& files, Time now);
  bool make_room(const FrameKey& wanted);
  void hand_out(const UnitKey& key);
  std::size_t most_handed_out() const;

  const RenderDeskOptions options_;
  UnitQueue& queue_;
  UnitLog& log_;
  EventLoop& mailbox_;
  const Callbacks outlet_;

  std::optional<RendererProcess::Child> first_;
  std::unique_ptr<RendererProcess> renderer_;
  std::int64_t generation_ = 0;  // of renderers; events of earlier ones are void
  std::optional<v1::RendererReady> ready_;
  Time start_at_{};  // not before, after a death
  Time heard_at_{};  // the renderer's last word, or when it last had nothing to do
  int deaths_in_a_row_ = 0;

  std::map<std::string, Job> jobs_;
  std::map<FrameKey, Frame> frames_;  // loaded, loading or refused
  std::map<UnitKey, Time> running_units_;  // units a thread of the renderer is at, since when
  std::optional<UnitKey> hung_;       // the one the renderer was killed for
  std::set<UnitKey> suspects_;        // units a renderer died of, or may have: rendered alone
  std::int64_t rendered_count_ = 0;
  double unit_seconds_ = 0;
  std::int64_t block_bytes_ = 0;
};

}  // namespace tessera::agent
