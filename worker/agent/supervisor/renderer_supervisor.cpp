#include "worker/agent/supervisor/renderer_supervisor.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "contract/film_block.h"

namespace tessera::agent {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kFirstRestartPause{100}, kLongestRestartPause{5'000};
constexpr int kMaxDeathsInARow = 5;         // before it has ever been ready
constexpr std::size_t kLookAhead = 32;      // units whose scenes are loaded in advance
constexpr double kShortUnitSeconds = 0.05;  // below it every thread gets a spare unit

double seconds_between(Time from, Time to) {
  return std::chrono::duration<double>(to - from).count();
}

UnitKey key_of(const v1::RenderUnit& unit) {
  return {unit.job_id(), {unit.frame(), unit.tile(), unit.pass()}};
}

}  // namespace

RendererSupervisor::RendererSupervisor(RendererSupervisorOptions options,
                                       std::optional<RendererProcess::Child> first,
                                       UnitQueue& queue, UnitLog& log, EventLoop& event_loop,
                                       Callbacks callbacks)
    : options_(std::move(options)),
      queue_(queue),
      log_(log),
      event_loop_(event_loop),
      callbacks_(std::move(callbacks)),
      first_(std::move(first)) {}

std::int64_t RendererSupervisor::renderer_rss_bytes() const {
  return renderer_ == nullptr ? 0 : resident_bytes(renderer_->pid());
}

void RendererSupervisor::start_renderer(Time now) {
  if (renderer_ != nullptr || now < start_at_) return;
  const std::int64_t generation = ++generation_;
  RendererProcess::Listener listener;
  listener.on_event = [this, generation](v1::RendererEvent event) {
    event_loop_.post([this, generation, event = std::move(event)]() mutable {
      on_event(generation, std::move(event));
    });
  };
  listener.on_death = [this, generation](RendererProcess::Death death) {
    event_loop_.post([this, generation, death = std::move(death)] { on_death(generation, death); });
  };
  if (!first_) {
    auto started = RendererProcess::start(options_.program, options_.arguments);
    if (!started.ok()) {
      callbacks_.failed_for_good(started.status());
      return;
    }
    first_ = *std::move(started);
  }
  renderer_ = std::make_unique<RendererProcess>(std::move(*first_), std::move(listener));
  first_.reset();
}

void RendererSupervisor::on_event(std::int64_t generation, v1::RendererEvent event) {
  if (generation != generation_ || renderer_ == nullptr) return;
  last_event_at_ = Clock::now();
  switch (event.event_case()) {
    case v1::RendererEvent::kReady:
      ready_ = std::move(*event.mutable_ready());
      if (!ready_->error().empty()) {
        callbacks_.failed_for_good(absl::InternalError(
            absl::StrCat("the renderer failed its numerics check: ", ready_->error())));
      }
      break;
    case v1::RendererEvent::kScene:
      on_scene(event.scene());
      break;
    case v1::RendererEvent::kStarted:
      running_units_[key_of(event.started())] = Clock::now();
      log_.write("started", key_of(event.started()));
      log_unit(LogLevel::debug, key_of(event.started()), " started");
      break;
    case v1::RendererEvent::kUnit:
      on_unit(std::move(*event.mutable_unit()));
      break;
    default:
      break;
  }
}

void RendererSupervisor::on_death(std::int64_t generation, const RendererProcess::Death& death) {
  if (generation != generation_) return;
  options_.log(LogLevel::warn, "", absl::StrCat("renderer process died: ", death.reason));
  callbacks_.renderer_died();
  const bool was_ready = ready_ && !running_units_.empty();
  renderer_.reset();
  consecutive_deaths_ = was_ready ? 1 : consecutive_deaths_ + 1;
  if (!ready_ && consecutive_deaths_ >= kMaxDeathsInARow) {
    callbacks_.failed_for_good(absl::InternalError(absl::StrCat(
        "the renderer process dies at startup: ", death.reason, "\n", death.log_tail)));
    return;
  }
  attribute_crash(death);
  frames_.clear();
  const milliseconds pause = kFirstRestartPause * (1 << std::min(consecutive_deaths_ - 1, 10));
  start_at_ = Clock::now() + std::min(pause, kLongestRestartPause);
}

/// Fails only the unit at fault. If several units may be at fault, each of them is rendered alone
/// from now on, so that the next death has one possible cause.
void RendererSupervisor::attribute_crash(const RendererProcess::Death& death) {
  const std::vector<UnitKey> causes = possible_causes();
  const std::vector<UnitKey> started = queue_.started();
  for (auto key = started.rbegin(); key != started.rend(); ++key) queue_.requeue(*key);
  suspect_units_.insert(causes.begin(), causes.end());
  if (causes.size() == 1) {
    const UnitKey& key = causes.front();
    const std::string message =
        hung_
            ? absl::StrCat("timed out after ", options_.unit_timeout.count(), " s; renderer killed")
            : absl::StrCat("renderer process died: ", death.reason,
                           running_units_.contains(key) ? "" : " while loading the scene");
    fail(key, message, death.log_tail,
         hung_ ? absl::StatusCode::kDeadlineExceeded : absl::StatusCode::kInternal);
  }
  running_units_.clear();
  hung_.reset();
}

/// Returns the unit that hung, if any. Otherwise returns the units being rendered and, for each
/// scene being loaded, one unit that waits for it.
std::vector<UnitKey> RendererSupervisor::possible_causes() const {
  if (hung_) return {*hung_};
  std::vector<UnitKey> causes;
  for (const auto& [key, since] : running_units_) {
    if (queue_.lease_of(key) != nullptr) causes.push_back(key);
  }
  for (const auto& [frame, state] : frames_) {
    if (!state.is_loading()) continue;
    const UnitKey* waits = nullptr;
    for (const UnitKey& key : queue_.waiting()) {
      if (FrameKey(key.job_id, key.unit.frame) != frame) continue;
      if (waits == nullptr || suspect_units_.contains(key)) waits = &key;
    }
    if (waits != nullptr) causes.push_back(*waits);
  }
  return causes;
}

void RendererSupervisor::on_scene(const v1::LoadSceneResult& outcome) {
  const auto found = frames_.find({outcome.job_id(), outcome.frame()});
  if (found == frames_.end()) return;  // its job has ended
  found->second.loaded = outcome.error().empty();
  if (!found->second.loaded) {  // pump() fails its units
    found->second.error =
        absl::Status(static_cast<absl::StatusCode>(outcome.error_code()), outcome.error());
    return;
  }
  options_.log(
      LogLevel::info, outcome.job_id(),
      absl::StrFormat("job %s, frame %d: scene loaded in %.3f s, built in %.3f s", outcome.job_id(),
                      outcome.frame(), outcome.load_seconds(), outcome.build_seconds()));
  v1::SceneLoaded loaded;
  loaded.set_job_id(outcome.job_id());
  loaded.set_frame(outcome.frame());
  loaded.set_load_seconds(outcome.load_seconds());
  loaded.set_build_seconds(outcome.build_seconds());
  loaded.set_peak_rss_bytes(outcome.peak_rss_bytes());
  loaded.set_accelerator_build_seconds(outcome.accelerator_build_seconds());
  loaded.set_accelerator_bytes(outcome.accelerator_bytes());
  callbacks_.scene_loaded(std::move(loaded));
}

void RendererSupervisor::on_unit(v1::RenderUnitResult outcome) {
  const UnitKey key = key_of(outcome.unit());
  Rendered rendered{0, outcome.cpu_seconds(), static_cast<std::int64_t>(outcome.block().size())};
  const auto running = running_units_.find(key);
  if (running != running_units_.end()) {
    rendered.seconds = seconds_between(running->second, Clock::now());
    unit_seconds_ =
        unit_seconds_ == 0 ? rendered.seconds : 0.75 * unit_seconds_ + 0.25 * rendered.seconds;
    running_units_.erase(running);
  }
  consecutive_deaths_ = 0;
  suspect_units_.erase(key);
  if (!outcome.error().empty()) {
    fail(key, outcome.error(), "", absl::StatusCode::kInternal);
    return;
  }
  if (options_.block_rendered) options_.block_rendered(*outcome.mutable_block());
  const contract::Digest sha256 = contract::sha256(outcome.block());
  const contract::TraversalCounts cost{outcome.ray_count(), outcome.visited_node_count(),
                                       outcome.tested_primitive_count()};
  if (!queue_.finish(key, std::move(*outcome.mutable_block()), sha256, outcome.cpu_seconds(),
                     cost)) {
    return;
  }
  log_.write("finished", key, sha256.hex());
  log_unit(LogLevel::debug, key,
           absl::StrCat(" rendered in ", outcome.cpu_seconds(), " s of CPU time"));
  callbacks_.unit_finished(rendered);
}

void RendererSupervisor::log_unit(LogLevel level, const UnitKey& unit, const std::string& text) {
  options_.log(level, unit.job_id, absl::StrCat("unit ", to_string(unit), text));
}

void RendererSupervisor::fail(const UnitKey& key, const std::string& message,
                              const std::string& log_tail, absl::StatusCode code) {
  auto failure = queue_.fail(key, valid_utf8(message), valid_utf8(log_tail), code);
  if (!failure) return;
  log_.write("failed", key, message);
  log_unit(LogLevel::warn, key, absl::StrCat(" failed: ", message));
  callbacks_.failed(*std::move(failure));
}

void RendererSupervisor::job_fetched(const std::string& job_id, absl::StatusOr<JobInputs> inputs) {
  const auto found = jobs_.find(job_id);
  if (found == jobs_.end()) return;  // the job has ended
  if (!inputs.ok()) {
    found->second.error = inputs.status();
    return;
  }
  const contract::FilmBlockShape largest{inputs->settings.tile, inputs->settings.tile,
                                         inputs->settings.aovs, true};
  block_bytes_ = std::max(block_bytes_, contract::film_block_bytes(largest));
  found->second.inputs = *std::move(inputs);
}

void RendererSupervisor::job_ended(const std::string& job_id) {
  jobs_.erase(job_id);
  std::erase_if(suspect_units_, [&](const UnitKey& key) { return key.job_id == job_id; });
  std::erase_if(frames_, [&](const auto& entry) { return entry.first.first == job_id; });
  if (renderer_ == nullptr) return;
  v1::RendererCommand command;
  command.mutable_unload_scene()->set_job_id(job_id);
  (void)renderer_->send(command);  // a dead renderer holds no scenes
}

void RendererSupervisor::pump(Time now) {
  start_renderer(now);
  if (renderer_ == nullptr || !ready_) return;
  if (kill_hung(now) || render_suspects(now)) return;
  // In the order of leases, skipping units whose scene is not loaded.
  const std::vector<UnitKey> waiting(queue_.waiting().begin(), queue_.waiting().end());
  std::size_t handed_out = queue_.started().size();
  std::size_t beyond = 0;  // units looked at to load their scenes in advance
  for (const UnitKey& key : waiting) {
    const bool room = handed_out < handed_out_limit();
    if (!room && ++beyond > kLookAhead) break;
    if (!prepare(key, now) || !room) continue;
    hand_out(key);
    ++handed_out;
  }
}

/// Returns whether the renderer has had work for longer than the timeout without starting a unit or
/// finishing a scene.
bool RendererSupervisor::is_renderer_silent(Time now) {
  const bool is_loading = std::any_of(frames_.begin(), frames_.end(),
                                      [](const auto& frame) { return frame.second.is_loading(); });
  if (!is_loading && queue_.started().empty()) last_event_at_ = now;
  return now - last_event_at_ >= options_.unit_timeout;
}

/// Kills the renderer if a unit exceeds the timeout or the renderer is silent. Returns whether it
/// did.
bool RendererSupervisor::kill_hung(Time now) {
  for (const auto& [key, since] : running_units_) {
    if (now - since < options_.unit_timeout) continue;
    log_unit(LogLevel::warn, key, " timed out; killing the renderer");
    if (!hung_) hung_ = key;
    renderer_->kill();
    return true;
  }
  if (!running_units_.empty() || !is_renderer_silent(now)) return false;
  options_.log(LogLevel::warn, "", "the renderer does not respond; killing it");
  renderer_->kill();
  return true;
}

/// Renders suspect units one at a time and nothing else. Returns false if there are none.
bool RendererSupervisor::render_suspects(Time now) {
  if (suspect_units_.empty()) return false;
  const auto is_suspect = [this](const UnitKey& key) { return suspect_units_.contains(key); };
  const std::vector<UnitKey> started = queue_.started();
  if (std::any_of(started.begin(), started.end(), is_suspect)) return true;
  const std::vector<UnitKey> waiting(queue_.waiting().begin(), queue_.waiting().end());
  const auto next = std::find_if(waiting.begin(), waiting.end(), is_suspect);
  if (next == waiting.end()) return false;
  const UnitKey& key = *next;
  const bool others_load = std::any_of(frames_.begin(), frames_.end(), [&](const auto& frame) {
    return frame.second.is_loading() && frame.first != FrameKey(key.job_id, key.unit.frame);
  });
  if (started.empty() && !others_load && prepare(key, now)) hand_out(key);
  return true;
}

/// Returns how many units the renderer may have: one per thread, plus spare ones so that no thread
/// waits for the agent.
std::size_t RendererSupervisor::handed_out_limit() const {
  const int spare =
      unit_seconds_ > 0 && unit_seconds_ < kShortUnitSeconds ? options_.thread_count : 1;
  return static_cast<std::size_t>(options_.thread_count) + static_cast<std::size_t>(spare);
}

/// Returns whether the unit's frame is loaded; starts fetching or loading it if necessary.
bool RendererSupervisor::prepare(const UnitKey& key, Time now) {
  if (!prepare_job(key)) return false;
  const FrameKey frame_key{key.job_id, key.unit.frame};
  const auto frame = frames_.find(frame_key);
  if (frame == frames_.end()) {
    load_frame(frame_key, *jobs_.at(key.job_id).inputs, now);
    return false;
  }
  if (!frame->second.error.ok()) {
    const absl::Status& error = frame->second.error;
    fail(key, std::string(error.message()), "", error.code());
    return false;
  }
  frame->second.used = now;
  return frame->second.loaded;
}

bool RendererSupervisor::prepare_job(const UnitKey& key) {
  const auto [place, is_new] = jobs_.try_emplace(key.job_id);
  const Job& job = place->second;
  if (is_new) callbacks_.fetch_job(key.job_id);
  if (job.inputs) return true;
  if (absl::IsNotFound(job.error)) {
    queue_.revoke({key});
    callbacks_.units_returned({key});
  } else if (!job.error.ok()) {
    fail(key, absl::StrCat("fetching assets: ", std::string(job.error.message())), "",
         absl::StatusCode::kUnavailable);
  }
  if (!job.error.ok()) jobs_.erase(place);  // fetched again for the next lease
  return false;
}

bool RendererSupervisor::load_frame(const FrameKey& key, const JobInputs& inputs, Time now) {
  if (!make_room(key)) return false;
  v1::RendererCommand command;
  v1::LoadScene& load = *command.mutable_load_scene();
  load.set_job_id(key.first);
  load.set_frame(key.second);
  *load.mutable_settings() = inputs.message;
  *load.mutable_manifest() = inputs.manifest;
  std::vector<int> descriptors;
  for (const Descriptor& descriptor : inputs.descriptors) descriptors.push_back(descriptor.get());
  if (!renderer_->send(command, descriptors).ok()) return false;
  frames_[key].used = now;
  return true;
}

/// Unloads the least recently used frames that neither a started unit nor the first waiting unit
/// needs, until another frame fits. Returns false if none can be unloaded.
bool RendererSupervisor::make_room(const FrameKey& wanted) {
  while (true) {
    std::size_t count = 0;
    auto oldest = frames_.end();
    for (auto frame = frames_.begin(); frame != frames_.end(); ++frame) {
      if (!frame->second.error.ok()) continue;  // takes no memory
      ++count;
      const FrameKey& key = frame->first;
      bool busy = !frame->second.loaded;
      for (const UnitKey& unit : queue_.started()) {
        busy |= unit.job_id == key.first && unit.unit.frame == key.second;
      }
      if (!queue_.waiting().empty()) {
        const UnitKey& head = queue_.waiting().front();
        busy |= head.job_id == key.first && head.unit.frame == key.second;
      }
      if (!busy && (oldest == frames_.end() || frame->second.used < oldest->second.used)) {
        oldest = frame;
      }
    }
    if (count < static_cast<std::size_t>(options_.loaded_frames)) return true;
    if (oldest == frames_.end() || oldest->first == wanted) return false;
    v1::RendererCommand command;
    command.mutable_unload_scene()->set_job_id(oldest->first.first);
    command.mutable_unload_scene()->set_frame(oldest->first.second);
    (void)renderer_->send(command);
    frames_.erase(oldest);
  }
}

void RendererSupervisor::hand_out(const UnitKey& key) {
  const v1::Lease& lease = *queue_.lease_of(key);
  v1::RendererCommand command;
  v1::RenderUnit& unit = *command.mutable_render_unit();
  unit.set_job_id(key.job_id);
  unit.set_frame(key.unit.frame);
  unit.set_tile(key.unit.tile);
  unit.set_pass(key.unit.pass);
  unit.set_first_sample(lease.first_sample());
  unit.set_sample_count(lease.sample_count());
  queue_.start(key);
  (void)renderer_->send(command);  // if it is dead, on_death requeues the unit
}

}  // namespace tessera::agent
