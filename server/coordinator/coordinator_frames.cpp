#include <algorithm>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/coordinator/coordinator.h"
#include "server/film/image_export.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr std::int64_t kReferencePixelBytes = 16;

constexpr auto kEstimateEvery = std::chrono::milliseconds(250);

std::string frame_file_name(std::int32_t frame) {
  return absl::StrFormat("frame.%04d.exr", frame);
}

std::string suspect_frame_warning(std::int32_t frame, const std::string& worker_id) {
  return absl::StrCat("frame ", frame, " may contain wrong pixels: it was finished before worker ",
                      worker_id, ", which rendered part of the job, was quarantined");
}

}  // namespace

void Coordinator::post_to_film(std::function<void()> task) {
  MutexLock lock(mutex_);
  enqueue_film(std::move(task));
}

void Coordinator::enqueue_film(std::function<void()> task) {
  film_tasks_.push_back(std::move(task));
  film_wakeup_.notify_all();
}

bool Coordinator::run_film(bool wait) {
  std::deque<std::function<void()>> tasks;
  {
    MutexLock lock(mutex_);
    while (wait && !stopping_ && film_tasks_.empty()) film_wakeup_.wait(mutex_);
    tasks.swap(film_tasks_);
  }
  for (const auto& task : tasks) task();
  return !tasks.empty();
}

absl::StatusOr<contract::FilmBlock> Coordinator::read_block(const std::string& job_id,
                                                            const Unit& unit) {
  std::optional<UnitRecord> record;
  contract::FilmBlockShape shape;
  std::int32_t sample_count = 0;
  {
    MutexLock lock(mutex_);
    Job* job = scheduler_.find_job(job_id);
    if (job == nullptr || !job->plan || !job->plan->contains(unit)) {
      return absl::NotFoundError("the job or the pass no longer exists");
    }
    record = open_block_index(*job).record(unit);
    const contract::PixelRect rect = tile_grid(*job).rect(unit.tile);
    shape = {rect.width, rect.height, job->spec->settings.aovs, unit.pass == 0};
    sample_count = job->plan->passes()[static_cast<std::size_t>(unit.pass)].sample_count;
  }
  if (!record) return absl::NotFoundError("block not committed");
  options_.metrics->film_blocks.read_back.Increment();
  const auto bytes = store_.read_block(job_id, *record);
  if (absl::IsDataLoss(bytes.status())) damaged_.push_back(unit);
  if (!bytes.ok()) return bytes.status();
  return contract::decode(*bytes, shape, sample_count);
}

/// Returns a reader of the frame's reference, if the job has one: an asset with R, G, B, A of each
/// pixel as little-endian float32, like the input of pixels_sha256.
ReferenceReader Coordinator::reference_reader(const JobSpec& spec, std::int32_t frame) {
  if (spec.references.empty()) return {};
  const std::vector<std::int32_t> frames = contract::frame_list(spec.settings.frames);
  const auto index = std::find(frames.begin(), frames.end(), frame) - frames.begin();
  const contract::Digest& digest = spec.references[static_cast<std::size_t>(index)];
  return [this, id = spec.id, path = store_.asset_path(digest),
          width = std::int64_t{spec.settings.width}](
             const contract::PixelRect& rect) -> absl::StatusOr<std::vector<float>> {
    std::ifstream file(path, std::ios::binary);
    const std::size_t row_floats = 4 * static_cast<std::size_t>(rect.width);
    std::vector<float> pixels(row_floats * static_cast<std::size_t>(rect.height));
    for (std::int32_t row = 0; row < rect.height; ++row) {
      file.seekg(((rect.y + row) * width + rect.x) * kReferencePixelBytes);
      file.read(reinterpret_cast<char*>(&pixels[static_cast<std::size_t>(row) * row_floats]),
                rect.width * kReferencePixelBytes);
    }
    if (file) return pixels;
    log(LogLevel::warn, absl::StrCat("job ", id, ": cannot read the reference: ", path));
    return absl::DataLossError(path);
  };
}

void Coordinator::open_film(const FrameKey& key) {
  if (film_.is_open(key)) return;
  std::shared_ptr<const JobSpec> spec;
  std::vector<Unit> units;
  {
    MutexLock lock(mutex_);
    Job* job = scheduler_.find_job(key.job_id);
    if (job == nullptr) return;
    spec = job->spec;
    units = open_block_index(*job).units(key.frame);
  }
  film_.open_frame(
      key, spec->settings,
      [this, key](std::int32_t tile, std::int32_t pass) {
        return read_block(key.job_id, {key.frame, tile, pass});
      },
      reference_reader(*spec, key.frame));
  for (const Unit& unit : units) {
    const absl::Status status = film_.record_committed(key, unit.tile, unit.pass);
    if (!status.ok())
      log(LogLevel::error, absl::StrCat("job ", key.job_id, ": ", status.ToString()));
  }
  decide(key);
}

/// Passes new targets of the film to the scheduler.
void Coordinator::decide(const FrameKey& key) {
  damaged_.clear();
  const auto demands = film_.take_pass_targets(key);
  if (!demands.ok()) {
    if (absl::IsNotFound(demands.status())) return;  // the job has been removed
    if (damaged_.empty()) return frame_failed(key, demands.status());
    log(LogLevel::warn, absl::StrCat("job ", key.job_id, ", frame ", key.frame, ": ",
                                     demands.status().ToString(), "; rendering it again"));
    film_.close_frame(key);
    post_to_writer([this, key, units = damaged_] { redo_units(key, units); });
    return;
  }
  if (demands->empty()) return;
  const auto expected = film_.expected_samples(key);
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  Job* job = scheduler_.find_job(key.job_id);
  if (job == nullptr || !job->plan || job->plan->is_finished(key.frame)) return;
  for (const contract::StoppingRule::PassTarget& demand : *demands) {
    scheduler_.set_pass_target(*job, key.frame, demand.tile, demand.pass_count, demand.is_final);
  }
  if (expected) job_film(*job).expected_samples[key.frame] = *expected;
  scheduler_.offer_work(options_.clock());
  finish_if_complete(*job, key.frame);
  apply_effects(deferred);
}

/// Opens the started frames of a job, to restore their pass targets.
void Coordinator::open_films(Job& job) {
  if (!job.plan || !job.plan->is_adaptive()) return;
  for (const std::int32_t frame : job.plan->frames()) {
    if (job.plan->is_finished(frame) || !open_block_index(job).has(frame)) continue;
    enqueue_film([this, key = FrameKey{job.spec->id, frame}] { open_film(key); });
  }
}

void Coordinator::merge(FilmUpdate update) {
  const FrameKey key{update.job_id, update.unit.frame};
  bool is_wanted = false;
  {
    MutexLock lock(mutex_);
    const Job* job = scheduler_.find_job(update.job_id);
    is_wanted = job != nullptr && job->plan && job->plan->contains(update.unit) &&
                !job->plan->is_finished(update.unit.frame);
  }
  if (is_wanted) {
    open_film(key);
    const Time started = options_.clock();
    const absl::Status status =
        update.block ? film_.add(key, update.unit.tile, update.unit.pass, *update.block)
                     : film_.record_committed(key, update.unit.tile, update.unit.pass);
    if (update.block) {
      options_.metrics->film_blocks.delivered.Increment();
      options_.metrics->merge_seconds.Observe(seconds(options_.clock() - started));
    }
    if (!status.ok())
      log(LogLevel::error, absl::StrCat("job ", key.job_id, ": ", status.ToString()));
    decide(key);
    estimate(key);
  }
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  ingest_bytes_ -= update.bytes;
  if (ingest_bytes_ >= options_.ingest_bytes) return;
  for (auto& resume : std::exchange(resumes_, {})) deferred.add(std::move(resume));
}

void Coordinator::estimate(const FrameKey& key) {
  const Time now = options_.clock();
  const auto last = last_estimate_.find(key);
  if (last != last_estimate_.end() && now - last->second < kEstimateEvery) return;
  last_estimate_[key] = now;
  const ErrorEstimate estimate = film_.running_estimate(key);
  if (estimate.pixels == 0) return;
  MutexLock lock(mutex_);
  Job* job = scheduler_.find_job(key.job_id);
  if (job != nullptr) job_film(*job).estimated_error = estimate.error;
}

void Coordinator::finish_frame(const FrameKey& key) {
  std::shared_ptr<const JobSpec> spec;
  {
    MutexLock lock(mutex_);
    Job* job = scheduler_.find_job(key.job_id);
    if (job == nullptr) return;
    if (has_ended(job->state) || !is_ready(*job, key.frame)) {
      job_film(*job).finishing.erase(key.frame);
      return;
    }
    spec = job->spec;
  }
  open_film(key);
  damaged_.clear();
  const Time started = options_.clock();
  auto record = write_finished(key, *spec);
  options_.metrics->frame_write_seconds.Observe(seconds(options_.clock() - started));
  const double error = film_.running_estimate(key).error;
  film_.close_frame(key);
  last_estimate_.erase(key);
  if (!record.ok() && !damaged_.empty()) {
    log(LogLevel::warn, absl::StrCat("job ", key.job_id, ", frame ", key.frame, ": ",
                                     record.status().ToString(), "; rendering it again"));
    post_to_writer([this, key, units = damaged_] { redo_units(key, units); });
    return;
  }
  if (!record.ok()) {
    frame_failed(key, record.status());
    return;
  }
  post_to_writer(
      [this, key, error, record = *std::move(record)] { record_frame(key, record, error); });
}

absl::StatusOr<FrameRecord> Coordinator::write_finished(const FrameKey& key, const JobSpec& spec) {
  const auto folder = store_.output_folder(key.job_id);
  if (!folder.ok()) return folder.status();
  const auto luminance = film_.mean_luminance(key);
  if (!luminance.ok()) return luminance.status();
  const StoppingStats stopping = film_.stopping(key);
  const FrameSpec frame{
      spec.settings,          key.frame, spec.id, spec.name, *luminance, stopping.looks,
      film_.max_samples(key), false};
  const std::string name = frame_file_name(key.frame);
  const auto result = write_frame(
      frame, [&](std::int32_t tile) { return film_.tile(key, tile); },
      absl::StrCat(*folder, "/", name));
  if (!result.ok()) return result.status();
  std::vector<BlockIndex::PassProgress> progress;
  {
    MutexLock lock(mutex_);
    if (Job* job = scheduler_.find_job(key.job_id))
      progress = open_block_index(*job).progress(key.frame);
  }
  std::vector<CurvePoint> curve;
  FrameSummary summary;
  CurvePoint point;
  for (std::size_t pass = 0; pass < progress.size() && progress[pass].committed > 0; ++pass) {
    const auto stats = film_.after_pass(key, static_cast<std::int32_t>(pass));
    point.cpu_seconds += progress[pass].cpu_seconds;
    point.wall_seconds = std::max(point.wall_seconds, progress[pass].wall_seconds);
    point.samples = stats.samples;
    point.relmse = stats.estimate.relmse;
    point.error = *luminance > 0 ? std::optional(stats.estimate.error) : std::nullopt;
    point.truth = stats.truth;
    curve.push_back(point);
    summary.unit_count += progress[pass].committed;
  }
  FrameRecord record;
  record.frame = key.frame;
  record.file = name;
  record.file_sha256 = result->file_sha256;
  record.pixels_sha256 = result->pixels_sha256;
  summary.spp = contract::rounded_spp(spec.settings.spp);
  summary.error = spec.settings.error;
  summary.samples = result->statistics.samples;
  summary.warnings = frame_warnings(result->statistics);
  std::string status = "DONE";
  if (summary.error) {
    ConvergenceResult convergence =
        assess_convergence(result->statistics, stopping, *summary.error);
    summary.certainty = convergence.certainty;
    summary.reasons = std::move(convergence.reasons);
    status = certainty_name(convergence.certainty);
  }
  summary.entry_json = frame_entry_json(*result, name, status, curve);
  record.statistics_json = write_frame_summary(summary);
  return record;
}

void Coordinator::count_finished(JobFilm& film, const FrameRecord& record,
                                 const FrameSummary& summary) {
  film.finished[record.frame] = record;
  film.expected_samples.erase(record.frame);
  film.finished_samples += summary.samples;
  if (summary.certainty)
    film.certainty = std::max(film.certainty.value_or(*summary.certainty), *summary.certainty);
}

void Coordinator::record_frame(const FrameKey& key, const FrameRecord& record, double error) {
  {
    MutexLock lock(mutex_);
    Job* job = scheduler_.find_job(key.job_id);
    // Units of a faulty worker may have been dropped since the image was written.
    if (job != nullptr && !has_ended(job->state) && !is_ready(*job, key.frame)) {
      job_film(*job).finishing.erase(key.frame);
      return;
    }
  }
  const absl::Status status = store_.finish_frame(key.job_id, record);
  if (!status.ok()) {
    frame_failed(key, status);
    return;
  }
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  Job* job = scheduler_.find_job(key.job_id);
  if (job == nullptr) return;
  JobFilm& film = job_film(*job);
  film.finishing.erase(key.frame);
  count_finished(film, record, read_frame_summary(record.statistics_json));
  film.estimated_error = error;
  open_block_index(*job).erase(key.frame);
  note(EventKind::frame_finished, *job, "", absl::StrCat("frame ", key.frame));
  deferred.add([this, key] {
    log(LogLevel::info, absl::StrCat("job ", key.job_id, ", frame ", key.frame, " finished"));
  });
  scheduler_.finish_frame(*job, key.frame, options_.clock());
  apply_effects(deferred);
}

/// Drops units whose blocks are unreadable or wrong; workers render them again.
/// `reset_pass_targets`: also withdraws the pass targets derived from them.
void Coordinator::redo_units(const FrameKey& key, const std::vector<Unit>& units,
                             bool reset_pass_targets) {
  const absl::Status status = store_.drop_units(key.job_id, units);
  if (!status.ok()) return frame_failed(key, status);
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  Job* job = scheduler_.find_job(key.job_id);
  if (job == nullptr) return;
  JobFilm& film = job_film(*job);
  film.finishing.erase(key.frame);
  for (const Unit& unit : units) {
    if (open_block_index(*job).find(unit) == nullptr) continue;
    open_block_index(*job).remove(unit);
    scheduler_.redo(*job, unit);
    const contract::PixelRect rect = tile_grid(*job).rect(unit.tile);
    film.committed_samples -= std::int64_t{rect.width} * rect.height *
                              job->plan->passes()[static_cast<std::size_t>(unit.pass)].sample_count;
  }
  if (reset_pass_targets) scheduler_.reset_pass_targets(*job, key.frame);
  enqueue_film([this, key] {  // rebuilds the film without them
    film_.close_frame(key);
    open_film(key);
  });
  scheduler_.offer_work(options_.clock());
  apply_effects(deferred);
}

/// Handles a frame that cannot be finished: pauses its job if the disk is full, else fails it.
void Coordinator::frame_failed(const FrameKey& key, const absl::Status& status) {
  const std::string reason = absl::StrCat("frame ", key.frame, ": ", status.ToString());
  options_.metrics->errors.film.Increment();
  log(LogLevel::error, absl::StrCat("job ", key.job_id, ", ", reason));
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  Job* job = scheduler_.find_job(key.job_id);
  if (job == nullptr) return;
  job_film(*job).finishing.erase(key.frame);
  if (absl::IsResourceExhausted(status)) {
    pause_for_room(*job, status);
  } else {
    scheduler_.fail_job(*job, absl::Status(status.code(), reason), options_.clock());
  }
  apply_effects(deferred);
}

// Audits -----------------------------------------------------------------------------------------

void Coordinator::end_audits(const std::vector<UnitName>& units) {
  for (const UnitName& name : units) {
    write_tasks_.emplace_back([this, name] {
      const absl::Status status = store_.end_audits(name.job_id, {name.unit});
      if (!status.ok()) log(LogLevel::error, absl::StrCat("audits: ", status.ToString()));
    });
    if (Job* job = scheduler_.find_job(name.job_id)) finish_if_complete(*job, name.unit.frame);
  }
  if (!units.empty()) writer_wakeup_.notify_all();
}

/// Quarantines a faulty worker: its units of unfinished frames are rendered again; finished frames
/// that may contain some are listed in their jobs' reports.
void Coordinator::quarantine_worker(const std::string& worker_id, DeferredCalls& deferred) {
  note(EventKind::worker_quarantined, worker_id, "delivered wrong pixels");
  deferred.add([this, worker_id] {
    log(LogLevel::error,
        absl::StrCat("worker ", worker_id, " quarantined: delivered wrong pixels"));
  });
  for (const auto& [job_key, job] : scheduler_.jobs()) {
    if (job.contributions.count(worker_id) == 0) continue;
    JobFilm& film = job_film(job);
    for (const auto& [frame, record] : film.finished) {
      film.warnings.push_back(suspect_frame_warning(frame, worker_id));
    }
    if (has_ended(job.state) || !job.plan) continue;
    for (const std::int32_t frame : job.plan->frames()) {
      if (job.plan->is_finished(frame) || !film.block_index || !film.block_index->has(frame))
        continue;
      film.finishing.insert(frame);  // only after they are dropped
      write_tasks_.emplace_back([this, key = FrameKey{job.spec->id, frame}, worker_id] {
        redo_units_by_worker(key, worker_id);
      });
    }
  }
  // After its units are dropped: a server that crashes before must detect the fault again.
  write_tasks_.emplace_back([this, names = scheduler_.shut_out_names(worker_id)] {
    for (const std::string& name : names) {
      const absl::Status status = store_.ban_worker(name);
      if (!status.ok()) log(LogLevel::error, absl::StrCat("quarantine: ", status.ToString()));
    }
  });
  writer_wakeup_.notify_all();
}

/// Drops a worker's units of a frame and the pass targets derived from them. On the writer thread.
void Coordinator::redo_units_by_worker(const FrameKey& key, const std::string& worker_id) {
  std::vector<Unit> units;
  {
    MutexLock lock(mutex_);
    Job* job = scheduler_.find_job(key.job_id);
    if (job == nullptr || has_ended(job->state)) return;
    job_film(*job).finishing.erase(key.frame);
    if (job->plan->is_finished(key.frame)) {
      job_film(*job).warnings.push_back(suspect_frame_warning(key.frame, worker_id));
      return;
    }
    const BlockIndex& block_index = open_block_index(*job);
    bool has_any = false;
    for (const Unit& unit : block_index.units(key.frame)) {
      const bool is_theirs = block_index.worker(*block_index.find(unit)) == worker_id;
      has_any = has_any || is_theirs;
      const bool was_decided = job->plan->is_adaptive() && unit.pass >= job->plan->first_passes();
      if (is_theirs || was_decided) units.push_back(unit);
    }
    if (!has_any) {
      finish_if_complete(*job, key.frame);
      return;
    }
  }
  redo_units(key, units, true);
}

// Images for clients -----------------------------------------------------------------------------

void Coordinator::fetch_frame(const FrameQuery& query,
                              std::function<void(absl::StatusOr<FrameFile>)> done) {
  post_to_film([this, query, done = std::move(done)] { done(make_frame_file(query)); });
}

absl::StatusOr<FrameFile> Coordinator::make_frame_file(const FrameQuery& query) {
  std::shared_ptr<const JobSpec> spec;
  std::optional<FrameRecord> finished;
  {
    MutexLock lock(mutex_);
    Job* job = scheduler_.find_job(query.job_id);
    if (job == nullptr) return absl::NotFoundError(absl::StrCat("no job \"", query.job_id, "\""));
    spec = job->spec;
    const auto& frames = job_film(*job).finished;
    if (const auto found = frames.find(query.frame); found != frames.end()) {
      finished = found->second;
    } else if (!job->open_plan().contains({query.frame, 0, 0})) {
      return absl::NotFoundError(absl::StrCat("job ", query.job_id, " has no frame ", query.frame));
    }
  }
  const auto folder = store_.output_folder(query.job_id);
  if (!folder.ok()) return folder.status();
  FrameFile file;
  if (finished) {
    file.path = absl::StrCat(*folder, "/", finished->file);
    file.file_sha256 = finished->file_sha256;
    file.pixels_sha256 = finished->pixels_sha256;
  } else if (query.allow_partial) {
    const auto partial = write_partial(query, *spec);
    if (!partial.ok()) return partial.status();
    file = *partial;
  } else {
    return absl::FailedPreconditionError(
        absl::StrCat("frame ", query.frame, " of job ", query.job_id, " is not finished"));
  }
  if (query.format == FrameFormat::exr) {
    std::error_code error;
    file.size_bytes = static_cast<std::int64_t>(std::filesystem::file_size(file.path, error));
    if (error) return absl::NotFoundError(absl::StrCat(file.path, ": ", error.message()));
    return file;
  }
  const auto format = query.format == FrameFormat::png ? ExportFormat::png : ExportFormat::jpeg;
  auto image = export_image(file.path, format, query.exposure_ev);
  std::error_code ignored;
  if (file.is_temporary) std::filesystem::remove(file.path, ignored);
  if (!image.ok()) return image.status();
  file.path.clear();
  file.is_temporary = false;
  file.size_bytes = static_cast<std::int64_t>(image->size());
  file.file_sha256 = contract::sha256(*image);
  file.bytes = *std::move(image);
  return file;
}

absl::StatusOr<FrameFile> Coordinator::write_partial(const FrameQuery& query, const JobSpec& spec) {
  const FrameKey key{query.job_id, query.frame};
  {
    MutexLock lock(mutex_);
    Job* job = scheduler_.find_job(query.job_id);
    if (job == nullptr || !open_block_index(*job).has(query.frame)) {
      return absl::FailedPreconditionError(
          absl::StrCat("no unit of frame ", query.frame, " is committed yet"));
    }
  }
  const bool was_open = film_.is_open(key);
  open_film(key);
  const auto folder = store_.output_folder(query.job_id);
  if (!folder.ok()) return folder.status();
  const std::string path = absl::StrCat(*folder, "/partial.", ++partial_count_, ".exr");
  const auto luminance = film_.mean_luminance(key);
  const FrameSpec frame{spec.settings,
                        query.frame,
                        spec.id,
                        spec.name,
                        luminance.ok() ? std::optional(*luminance) : std::nullopt,
                        film_.stopping(key).looks,
                        film_.max_samples(key),
                        true};
  const auto result = write_frame(
      frame, [&](std::int32_t tile) { return film_.tile(key, tile); }, path);
  if (!was_open) film_.close_frame(key);
  if (!result.ok()) return result.status();
  FrameFile file;
  file.path = path;
  file.is_temporary = true;
  file.size_bytes = result->file_bytes;
  file.file_sha256 = result->file_sha256;
  file.missing_tiles = result->missing_tiles;
  return file;
}

}  // namespace tessera::server
