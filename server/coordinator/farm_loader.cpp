#include "server/coordinator/farm_loader.h"

#include <algorithm>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/version.h"
#include "server/jobs/job_admin.h"
#include "server/state/failed_attempts.h"

namespace tessera::server {
namespace {

/// Restores the sums over units whose rows are deleted.
absl::Status restore_totals(const Store& store, Scheduler& scheduler, Job& job) {
  const auto totals = store.units().totals(job.spec->id);
  if (!totals.ok()) return totals.status();
  for (const UnitTotals& total : *totals) {
    scheduler.results().restore_contribution(job, total.worker_id,
                                             {total.units, total.cpu_seconds});
    job.counters.audited += total.audited;
  }
  return absl::OkStatus();
}

/// Restores a job's units from the journal; those of unfinished frames also go to `visit_open`.
absl::Status restore_units(const Store& store, Scheduler& scheduler, Job& job,
                           const std::function<void(const UnitRecord&)>& visit_open) {
  if (absl::Status status = restore_totals(store, scheduler, job); !status.ok()) return status;
  const JobPlan& plan = job.open_plan();
  return store.units().for_each(job.spec->id, [&](const UnitRecord& unit) {
    if (!plan.contains(unit.unit)) return;
    scheduler.results().restore_unit(job, unit.unit, unit.worker_id, unit.cpu_seconds);
    if (unit.audit == AuditState::ended) ++job.counters.audited;
    if (!plan.is_finished(unit.unit.frame)) visit_open(unit);
  });
}

/// Restores the cost of a job whose units this server does not read.
absl::Status restore_costs(const Store& store, Scheduler& scheduler, Job& job) {
  if (absl::Status status = restore_totals(store, scheduler, job); !status.ok()) return status;
  return store.units().for_each(job.spec->id, [&](const UnitRecord& unit) {
    scheduler.results().restore_contribution(job, unit.worker_id, {1, unit.cpu_seconds});
  });
}

/// Returns whether any unit of the job has been rendered.
absl::StatusOr<bool> has_started(const Store& store, const std::string& job_id,
                                 const std::vector<FrameRecord>& frames) {
  if (!frames.empty()) return true;
  bool started = false;
  absl::Status status = store.units().for_each(job_id, [&](const UnitRecord&) { started = true; });
  if (!status.ok()) return status;
  return started;
}

/// Returns the frames with the job's settings. Others are older than an extension, or damaged.
std::vector<FarmLoader::FinishedFrame> finished_frames(const std::vector<FrameRecord>& records,
                                                       const contract::RenderSettings& settings) {
  std::vector<FarmLoader::FinishedFrame> frames;
  for (const FrameRecord& record : records) {
    FrameSummary summary = read_frame_summary(record.statistics_json);
    if (summary.fits(settings)) frames.push_back({record, std::move(summary)});
  }
  return frames;
}

}  // namespace

absl::Status FarmLoader::load() {
  const auto banned = parts_.store.workers().banned_workers();
  if (!banned.ok()) return banned.status();
  const auto records = parts_.store.jobs().list();
  if (!records.ok()) return records.status();
  FarmChange change(parts_.farm);
  for (const std::string& worker_id : *banned) change.scheduler().quarantine().ban(worker_id);
  for (const JobRecord& record : *records) {
    absl::Status status = load_job(change, record);
    if (status.ok()) status = note_removed(change, record.id);
    if (!status.ok()) list_unreadable(change, record, status);
  }
  return load_kept(change);
}

/// Counts what jobs keep on disk for the quotas of their owners.
absl::Status FarmLoader::load_kept(FarmChange& change) {
  const auto kept = parts_.store.usage().kept();
  if (!kept.ok()) return kept.status();
  for (const auto& [sequence, bytes] : *kept) {
    const Job* job = change.scheduler().jobs().find(sequence);
    if (job == nullptr) continue;
    change.film(*job).image_bytes = bytes.image_bytes;
    change.film(*job).block_bytes = bytes.block_bytes;
    change.note_kept(*job);
  }
  return absl::OkStatus();
}

/// Lists a job of which a row or file cannot be read as failed, without what has been loaded of it.
/// Its rows and files stay as they are, until a user removes it.
void FarmLoader::list_unreadable(FarmChange& change, const JobRecord& record,
                                 const absl::Status& fault) {
  const std::string reason = absl::StrCat(
      "the server cannot read it: ", std::string(fault.message()),
      "; `tessera-server check` of the stopped store finds the damage, `tessera remove ", record.id,
      "` deletes the job");
  change.log(LogLevel::error, absl::StrCat("job ", record.id, ": ", reason));
  JobSpec spec;
  if (Job* loaded = change.find_job(record.id); loaded != nullptr) {
    spec = *loaded->spec;
    // Ends its audits.
    if (!has_ended(loaded->state)) {
      change.scheduler().lifecycle().fail_job(*loaded, fault, change.now());
    }
    parts_.finisher.close_frames(*loaded);
    change.remove_job(*loaded);
  }
  spec.id = record.id;
  spec.request_id = record.request_id;
  spec.name = record.name;
  spec.owner = record.owner;
  spec.project = record.project;
  spec.is_unreadable = true;
  Job& job = change.add_job(record.sequence, std::make_shared<const JobSpec>(std::move(spec)),
                            JobState::failed);
  job.reason = reason;
  job.failure_code = fault.code();
  job.wall_seconds_before = record.wall_seconds;
  change.film(job).create_time_us = record.create_time_us;
  change.film(job).end_time_us = record.end_time_us;  // without end_served_us: not removed by age
}

absl::Status FarmLoader::load_job(FarmChange& change, const JobRecord& record) {
  auto spec = parts_.farm.options().read_spec(record);
  if (!spec.ok()) return spec.status();
  const auto records = parts_.store.frames().list(record.id);
  if (!records.ok()) return records.status();
  if (record.state < 1 || record.state > static_cast<std::int32_t>(kJobStates)) {
    return absl::DataLossError(absl::StrCat("its state is ", record.state));
  }
  auto state = static_cast<JobState>(record.state);
  const bool is_current_contract = record.render_contract == contract::kRenderContract;
  bool started = true;
  if (state == JobState::queued || !is_current_contract) {
    const auto found = has_started(parts_.store, record.id, *records);
    if (!found.ok()) return found.status();
    started = *found;
  }
  if (started) spec->render_contract = record.render_contract;
  const std::vector<FinishedFrame> frames = finished_frames(*records, spec->settings);
  if (state == JobState::done && is_current_contract) {
    const std::size_t wanted = contract::frame_list(spec->settings.frames).size();
    if (frames.size() < wanted) {  // the rows of the others were damaged
      change.log(LogLevel::warn, absl::StrCat("job ", record.id, ": frames are lost: ",
                                              wanted - frames.size(), "; rendering them again"));
      state = JobState::running;
    }
  }
  spec->request_id = record.request_id;
  parts_.assets.add_job(record.sequence, *spec);
  Job& job =
      change.add_job(record.sequence, std::make_shared<const JobSpec>(*std::move(spec)), state);
  job.reason = record.reason;
  job.failure_code = static_cast<absl::StatusCode>(record.failure_code);
  job.failed_attempts = read_failed_attempts(record.failed_attempts);
  job.wall_seconds_before = record.wall_seconds;
  JobFilm& film = change.film(job);
  film.create_time_us = record.create_time_us;
  if (has_ended(state)) film.end_time_us = record.end_time_us;
  if (film.end_time_us > 0) {  // after a crash, the time of service may be less than at its end
    change.set_end_served(job, std::min(record.end_served_us, change.served_us()));
  }
  film.wall_at_start = record.wall_seconds;
  if (!started && !is_current_contract) {
    parts_.pipeline.write_row(change, job.key);  // none of its blocks has another contract
  }
  if (!started && state == JobState::queued) return absl::OkStatus();
  load_frames(change, job, frames);
  const absl::Status same = check_render_contract(*job.spec);
  if (same.ok() || state == JobState::done) return load_units(change, job, record);
  if (!has_ended(state)) change.scheduler().lifecycle().fail_job(job, same, change.now());
  return restore_costs(parts_.store, change.scheduler(), job);
}

/// Tells the scheduler how jobs ended that this one waits for and that were removed.
absl::Status FarmLoader::note_removed(FarmChange& change, const std::string& job_id) {
  const std::vector<Dependency> after = change.find_job(job_id)->spec->after;
  for (const Dependency& dependency : after) {
    if (change.find_job(dependency.job_id) != nullptr) continue;
    const auto state = parts_.store.jobs().removed_state(dependency.job_id);
    if (!state.ok()) return state.status();
    if (!state->has_value()) continue;
    // A job without a row was done: its removal before that would have failed this job.
    const JobState ended = **state == 0 ? JobState::done : static_cast<JobState>(**state);
    change.scheduler().lifecycle().note_removed(dependency.job_id, ended);
  }
  return absl::OkStatus();
}

void FarmLoader::load_frames(FarmChange& change, Job& job,
                             const std::vector<FinishedFrame>& frames) {
  JobFilm& film = change.film(job);
  job.open_plan();
  for (const auto& [record, summary] : frames) {
    film.count_finished(record, summary);
    change.scheduler().results().restore_frame(job, record.frame, summary.unit_count);
    film.committed_samples += summary.samples;
  }
}

absl::Status FarmLoader::load_units(FarmChange& change, Job& job, const JobRecord& record) {
  JobPlan& plan = job.open_plan();
  JobFilm& film = change.film(job);
  Scheduler& scheduler = change.scheduler();
  absl::Status status = restore_units(parts_.store, scheduler, job, [&](const UnitRecord& unit) {
    film.open_block_index(job).add(unit, record.wall_seconds);
    if (unit.audit == AuditState::open) {
      scheduler.audits().open_audit(job, unit.unit, unit.worker_id, unit.sha256);
    }
    film.committed_samples += film.unit_samples(job, unit.unit);
  });
  if (!status.ok()) return status;
  film.samples_at_start = film.committed_samples;
  if (has_ended(job.state)) return absl::OkStatus();
  parts_.finisher.catch_up(change, job);
  if (plan.finished_frame_count() == plan.shape().frame_count()) {
    scheduler.lifecycle().end_job(job, JobState::done, "", change.now());
  }
  return absl::OkStatus();
}

}  // namespace tessera::server
