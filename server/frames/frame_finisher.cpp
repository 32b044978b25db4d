#include "server/frames/frame_finisher.h"

#include <algorithm>
#include <chrono>
#include <limits>

#include "absl/strings/str_cat.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr auto kEstimateEvery = std::chrono::milliseconds(250);

/// Returns whether all units of a frame are committed, no audit is open, and no units of a faulty
/// worker are left.
bool is_ready(FarmChange& change, const Job& job, std::int32_t frame) {
  return job.plan->is_complete(frame) && !change.scheduler().audits().has_audits(job, frame) &&
         change.film(job).suspect.count(frame) == 0;
}

}  // namespace

FrameFinisher::FrameFinisher(FarmState& farm, Store& store, CommitPipeline& pipeline,
                             Budgets& budgets)
    : farm_(farm),
      store_(store),
      pipeline_(pipeline),
      budgets_(budgets),
      films_(farm, store),
      // One thread is left for small tasks.
      tasks_({std::max(1, farm.options().film_threads - 1), farm.options().image_memory_bytes}) {}

void FrameFinisher::merge(FilmUpdate update) {
  const FrameKey key{update.job_id, update.unit.frame};
  tasks_.post(key, [this, shared = std::make_shared<const FilmUpdate>(std::move(update))] {
    merge_now(*shared);
  });
}

void FrameFinisher::finish_if_complete(FarmChange& change, Job& job, std::int32_t frame) {
  if (has_ended(job.state) || !is_ready(change, job, frame) || job.plan->is_finished(frame)) return;
  if (!change.film(job).finishing.insert(frame).second) return;
  const FrameKey key{job.spec->id, frame};
  tasks_.post(
      key, [this, key] { finish(key); }, writing_bytes(job.spec->settings));
}

void FrameFinisher::catch_up(FarmChange& change, Job& job) {
  if (!job.plan) return;
  for (const std::int32_t frame : job.plan->shape().frames) finish_if_complete(change, job, frame);
  open_started(change, job);
}

/// Opens the started frames of a job with a target error, to restore their pass targets.
void FrameFinisher::open_started(FarmChange& change, Job& job) {
  if (!job.plan->shape().is_adaptive) return;
  const BlockIndex& blocks = change.film(job).open_block_index(job);
  for (const std::int32_t frame : job.plan->shape().frames) {
    if (job.plan->is_finished(frame) || !blocks.has(frame)) continue;
    const FrameKey key{job.spec->id, frame};
    tasks_.post(key, [this, key] { open(key); });
  }
}

void FrameFinisher::close_frames(const Job& job) {
  using Frames = std::numeric_limits<std::int32_t>;
  const std::string& id = job.spec->id;
  // Frames that a task may open, then those that are open.
  std::vector<FrameKey> keys = tasks_.keys({id, Frames::min()}, {id, Frames::max()});
  const std::vector<FrameKey> open = films_.cache().open_frames(id);
  keys.insert(keys.end(), open.begin(), open.end());
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  for (const FrameKey& key : keys) tasks_.post(key, [this, key] { close(key); });
}

void FrameFinisher::carry_out(FarmChange& change, const Effects& effects) {
  for (const JobKey key : effects.changed) {
    const Job* job = change.scheduler().jobs().find(key);
    // The frames of a job that is done are closed one by one.
    if (job != nullptr && has_ended(job->state) && job->state != JobState::done) close_frames(*job);
  }
}

// The film threads -------------------------------------------------------------------------------

bool FrameFinisher::open(const FrameKey& key) {
  const bool is_new = films_.open(key);
  if (is_new) decide(key);
  return is_new;
}

/// Passes new targets of the film to the scheduler. If a look is due, it is the frame's next task.
void FrameFinisher::decide(const FrameKey& key) {
  films_.take_damaged(key);
  if (const absl::Status status = pass_targets(key); !status.ok()) return handle(key, status);
  if (!films_.cache().is_look_due(key)) return;
  const std::shared_ptr<const JobSpec> spec = find_spec(key);
  if (spec == nullptr) return;
  tasks_.post_next(
      key, [this, key] { look(key); }, writing_bytes(spec->settings));
}

/// Takes the look that is due, then decides again.
void FrameFinisher::look(const FrameKey& key) {
  const std::shared_ptr<const JobSpec> spec = find_spec(key);
  if (spec == nullptr || !films_.cache().is_look_due(key)) return;
  films_.take_damaged(key);
  const absl::Status status = take_denoised_look(films_.cache(), key, *spec);
  if (!status.ok()) return handle(key, status);
  decide(key);
}

/// Returns the spec of the frame's job; nullptr if the job has been removed.
std::shared_ptr<const JobSpec> FrameFinisher::find_spec(const FrameKey& key) const {
  const FarmView view(farm_);
  const Job* job = view.find_job(key.job_id);
  return job == nullptr ? nullptr : job->spec;
}

/// Handles a film that cannot be read.
void FrameFinisher::handle(const FrameKey& key, const absl::Status& status) {
  if (absl::IsNotFound(status)) return;  // the job has been removed
  if (!redo_damaged(key, status)) fail(key, status);
}

absl::Status FrameFinisher::pass_targets(const FrameKey& key) {
  const auto demands = films_.cache().take_pass_targets(key);
  if (!demands.ok()) return demands.status();
  if (demands->empty()) return absl::OkStatus();
  const auto expected = films_.cache().expected_samples(key);
  FarmChange change(farm_);
  Job* job = change.find_job(key.job_id);
  if (job == nullptr || !job->plan || job->plan->is_finished(key.frame)) return absl::OkStatus();
  if (!films_.is_current(change, key)) return absl::OkStatus();  // open() decides again
  for (const contract::PassRule::PassTarget& demand : *demands) {
    change.scheduler().results().set_pass_target(*job, key.frame, demand.tile, demand.pass_count,
                                                 demand.is_final);
  }
  if (expected) change.film(*job).expected_samples[key.frame] = *expected;
  change.scheduler().dispatcher().dispatch_all(change.now());
  finish_if_complete(change, *job, key.frame);
  return absl::OkStatus();
}

/// If reading the frame failed because of damaged blocks, has them rendered again and returns true.
bool FrameFinisher::redo_damaged(const FrameKey& key, const absl::Status& status) {
  std::vector<Unit> damaged = films_.take_damaged(key);
  if (damaged.empty()) return false;
  farm_.log(LogLevel::warn, absl::StrCat("job ", key.job_id, ", frame ", key.frame, ": ",
                                         status.ToString(), "; rendering it again"));
  close(key);
  pipeline_.post([this, key, units = std::move(damaged)] { redo(key, units); });
  return true;
}

void FrameFinisher::merge_now(const FilmUpdate& update) {
  const FrameKey key{update.job_id, update.unit.frame};
  bool is_wanted = false, is_current = false, is_open = false;
  {
    const FarmView view(farm_);
    const Job* job = view.find_job(update.job_id);
    is_wanted = job != nullptr && !has_ended(job->state) && job->plan &&
                job->plan->contains(update.unit) && !job->plan->is_finished(update.unit.frame);
    is_current = is_wanted && view.film(*job).revision == update.revision;
    is_open = films_.is_current(view, key);
  }
  // A film without this unit would be out of date if the job is retried.
  if (!is_wanted) return close(key);
  if (!is_open) open(key);
  if (!is_current) return;  // what is left of it is in the film that was opened
  const Time started = farm_.now();
  FilmCache& cache = films_.cache();
  const absl::Status status =
      update.block ? cache.add(key, update.unit.tile, update.unit.pass, *update.block)
                   : cache.record_committed(key, update.unit.tile, update.unit.pass);
  if (update.block) {
    farm_.metrics().film_blocks.delivered.Increment();
    farm_.metrics().merge_seconds.Observe(seconds(farm_.now() - started));
  }
  if (!status.ok()) {
    farm_.log(LogLevel::error, absl::StrCat("job ", key.job_id, ": ", status.ToString()));
  }
  decide(key);
  estimate(key);
}

void FrameFinisher::estimate(const FrameKey& key) {
  {
    const Time now = farm_.now();
    const MutexLock lock(mutex_);
    const auto [last, is_first] = last_estimate_.try_emplace(key, now);
    if (!is_first && now - last->second < kEstimateEvery) return;
    last->second = now;
  }
  const ErrorEstimate estimate = films_.cache().running_estimate(key);
  if (estimate.pixels == 0) return;
  FarmChange change(farm_);
  Job* job = change.find_job(key.job_id);
  if (job != nullptr) change.film(*job).estimated_error = estimate.error;
}

void FrameFinisher::close(const FrameKey& key) {
  films_.close(key);
  const MutexLock lock(mutex_);
  last_estimate_.erase(key);
}

void FrameFinisher::finish(const FrameKey& key) {
  std::shared_ptr<const JobSpec> spec;
  std::vector<BlockIndex::PassProgress> progress;
  std::int64_t revision = 0;
  {
    FarmChange change(farm_);
    Job* job = change.find_job(key.job_id);
    if (job == nullptr) return;
    JobFilm& film = change.film(*job);
    if (has_ended(job->state) || !is_ready(change, *job, key.frame)) {
      film.finishing.erase(key.frame);
      return;
    }
    spec = job->spec;
    revision = film.revision;
    progress = film.open_block_index(*job).progress(key.frame);
  }
  if (open(key) && films_.cache().is_look_due(key)) {  // the look comes first
    return tasks_.post_next(
        key, [this, key] { finish(key); }, writing_bytes(spec->settings));
  }
  films_.take_damaged(key);
  const Time started = farm_.now();
  auto finished = write_finished_frame(films_.cache(), store_, key, *spec, progress);
  farm_.metrics().frame_write_seconds.Observe(seconds(farm_.now() - started));
  if (!finished.ok()) {
    if (!redo_damaged(key, finished.status())) fail(key, finished.status());
    FarmChange change(farm_);
    const Job* job = change.find_job(key.job_id);
    if (job != nullptr) change.film(*job).finishing.erase(key.frame);
  }
  close(key);
  if (!finished.ok()) return;
  const auto frame = std::make_shared<const FinishedFrame>(*std::move(finished));
  pipeline_.post_write(
      [this, key, frame, spec, revision] {
        if (!may_record(key, revision)) return absl::CancelledError("its units are rendered again");
        const FrameRecord& record = frame->record;
        absl::Status written = frame->image.empty()
                                   ? store_.frames().finish(key.job_id, record)
                                   : store_.frames().finish_small(key.job_id, record, frame->image);
        if (written.ok()) tell_finished(key, spec->owner);
        return written;
      },
      [this, key, frame](const absl::Status& status) {
        if (status.ok()) return note_finished(key, *frame);
        if (absl::IsCancelled(status)) return finish_again(key);
        fail(key, status);
      });
}

// The writer thread ------------------------------------------------------------------------------

/// Returns whether the image is still right: no units were dropped, and the plan was not replaced,
/// after finish() began.
bool FrameFinisher::may_record(const FrameKey& key, std::int64_t revision) {
  FarmChange change(farm_);
  const Job* job = change.find_job(key.job_id);
  return job != nullptr && change.film(*job).revision == revision &&
         (has_ended(job->state) || is_ready(change, *job, key.frame));
}

/// Finishes a frame whose image was out of date, when it is complete.
void FrameFinisher::finish_again(const FrameKey& key) {
  FarmChange change(farm_);
  Job* job = change.find_job(key.job_id);
  if (job == nullptr) return;
  change.film(*job).finishing.erase(key.frame);
  finish_if_complete(change, *job, key.frame);
}

void FrameFinisher::tell_finished(const FrameKey& key, const std::string& owner) {
  pipeline_.tell(
      {0, 0, EventKind::frame_finished, key.job_id, owner, "", absl::StrCat("frame ", key.frame)});
}

void FrameFinisher::note_finished(const FrameKey& key, const FinishedFrame& frame) {
  FarmChange change(farm_);
  Job* job = change.find_job(key.job_id);
  if (job == nullptr) return;
  JobFilm& film = change.film(*job);
  film.finishing.erase(key.frame);
  film.count_finished(frame.record, frame.summary);
  if (has_ended(job->state)) change.note_kept(*job);
  film.open_block_index(*job).erase(key.frame);
  change.log(LogLevel::info, absl::StrCat("job ", key.job_id, ", frame ", key.frame, " finished"));
  change.scheduler().results().finish_frame(*job, key.frame, change.now());
  // A unit that is merged after finish() opens the film again.
  if (films_.cache().is_open(key) || !tasks_.keys(key, key).empty())
    tasks_.post(key, [this, key] { close(key); });
}

/// Drops units whose blocks are damaged, and has them rendered again.
void FrameFinisher::redo(const FrameKey& key, const std::vector<Unit>& units) {
  const absl::Status status = store_.units().drop(key.job_id, units);
  if (!status.ok()) return fail(key, status);
  forget(key, units, false);
}

void FrameFinisher::forget(const FrameKey& key, const std::vector<Unit>& units,
                           bool reset_pass_targets) {
  const std::shared_ptr<const JobSpec> spec = find_spec(key);
  if (spec != nullptr) budgets_.recount(*spec);  // they are no longer charged
  FarmChange change(farm_);
  Job* job = change.find_job(key.job_id);
  if (job == nullptr) return;
  JobFilm& film = change.film(*job);
  ++film.revision;
  for (const Unit& unit : units) {
    BlockIndex& blocks = film.open_block_index(*job);
    if (blocks.find(unit) == nullptr) continue;
    blocks.remove(unit);
    change.scheduler().results().redo(*job, unit);
    film.committed_samples -= film.unit_samples(*job, unit);
  }
  if (reset_pass_targets) change.scheduler().results().reset_pass_targets(*job, key.frame);
  tasks_.post(key, [this, key] { open(key); });  // rebuilds the film without them
  change.scheduler().dispatcher().dispatch_all(change.now());
}

/// Handles a frame that cannot be finished: pauses its job if the disk is full, else fails it.
void FrameFinisher::fail(const FrameKey& key, const absl::Status& status) {
  const std::string reason = absl::StrCat("frame ", key.frame, ": ", status.ToString());
  farm_.metrics().errors.film.Increment();
  farm_.log(LogLevel::error, absl::StrCat("job ", key.job_id, ", ", reason));
  FarmChange change(farm_);
  Job* job = change.find_job(key.job_id);
  if (job == nullptr) return;
  change.film(*job).finishing.erase(key.frame);
  if (absl::IsResourceExhausted(status)) {
    change.pause_for_room(*job, status);
  } else {
    change.scheduler().lifecycle().fail_job(*job, absl::Status(status.code(), reason),
                                            change.now());
  }
}

}  // namespace tessera::server
