#include "server/frames/audit_outcomes.h"

#include <algorithm>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/film/frame_summary.h"

namespace tessera::server {

using contract::Unit;

namespace {

std::string suspect_frame_warning(std::int32_t frame, const std::string& worker_id) {
  return absl::StrCat("frame ", frame, " may contain wrong pixels: it was finished before worker ",
                      worker_id, ", which rendered part of the job, was quarantined");
}

}  // namespace

void AuditOutcomes::carry_out(FarmChange& change, const Effects& effects) {
  farm_.metrics().audits_ended.Increment(static_cast<double>(effects.audited.size()));
  farm_.metrics().workers_quarantined.Increment(static_cast<double>(effects.faulty_workers.size()));
  for (const UnitName& unit : effects.audited) end_audit(change, unit);
  for (const std::string& worker_id : effects.faulty_workers) quarantine(change, worker_id);
}

void AuditOutcomes::end_audit(FarmChange& change, const UnitName& unit) {
  pipeline_.post_write([this, unit] { return store_.units().end_audits(unit.job_id, {unit.unit}); },
                       [this](const absl::Status& status) { log_failure("audits", status); });
  Job* job = change.find_job(unit.job_id);
  if (job != nullptr) finisher_.finish_if_complete(change, *job, unit.unit.frame);
}

void AuditOutcomes::quarantine(FarmChange& change, const std::string& worker_id) {
  change.note(EventKind::worker_quarantined, worker_id, "delivered wrong pixels");
  change.log(LogLevel::error,
             absl::StrCat("worker ", worker_id, " quarantined: delivered wrong pixels"));
  for (const auto& [job_key, job] : change.scheduler().jobs().all()) {
    if (job.contributions.count(worker_id) == 0) continue;
    JobFilm& film = change.film(job);
    std::vector<std::int32_t> finished;
    for (const auto& [frame, record] : film.finished) finished.push_back(frame);
    doubt_frames(change, job, finished, worker_id);
    if (has_ended(job.state) || !job.plan || !film.block_index) continue;
    for (const std::int32_t frame : job.plan->shape().frames) {
      if (job.plan->is_finished(frame) || !film.block_index->has(frame)) continue;
      redo_frame(change, job, frame, worker_id);
    }
  }
  // After its units are dropped: a server that crashes before must detect the fault again.
  pipeline_.post_write(
      [this, names = change.scheduler().quarantine().names_to_ban(worker_id)] {
        absl::Status status;
        for (const std::string& name : names) status.Update(store_.workers().ban_worker(name));
        return status;
      },
      [this](const absl::Status& status) { log_failure("quarantine", status); });
}

void AuditOutcomes::log_failure(const char* what, const absl::Status& status) const {
  if (!status.ok()) farm_.log(LogLevel::error, absl::StrCat(what, ": ", status.ToString()));
}

void AuditOutcomes::redo_frame(FarmChange& change, const Job& job, std::int32_t frame,
                               const std::string& worker_id) {
  FrameFinisher::hold(change, job, frame);
  pipeline_.post(
      [this, key = FrameKey{job.spec->id, frame}, worker_id] { redo_now(key, worker_id); });
}

/// Lists finished frames that may contain units of a faulty worker, and records that.
void AuditOutcomes::doubt_frames(FarmChange& change, const Job& job,
                                 const std::vector<std::int32_t>& frames,
                                 const std::string& worker_id) {
  if (frames.empty()) return;
  for (const std::int32_t frame : frames) {
    change.film(job).warnings.push_back(suspect_frame_warning(frame, worker_id));
  }
  pipeline_.post([this, id = job.spec->id, frames, worker_id] {
    log_failure("warnings of finished frames", write_doubts(id, frames, worker_id));
  });
}

/// Adds a doubt to the rows of finished frames. On the writer thread.
absl::Status AuditOutcomes::write_doubts(const std::string& job_id,
                                         const std::vector<std::int32_t>& frames,
                                         const std::string& worker_id) {
  auto rows = store_.frames().list(job_id);
  if (!rows.ok()) return rows.status();
  absl::Status written;
  const absl::Status together = store_.write_together([&] {
    for (const FrameRecord& row : *rows) {
      if (std::find(frames.begin(), frames.end(), row.frame) == frames.end()) continue;
      FrameSummary summary = read_frame_summary(row.statistics_json);
      summary.doubts.push_back(suspect_frame_warning(row.frame, worker_id));
      written.Update(
          store_.frames().update_statistics(job_id, row.frame, write_frame_summary(summary)));
    }
  });
  return together.ok() ? written : together;
}

/// Drops a worker's units of a frame and the pass targets derived from them. On the writer thread.
void AuditOutcomes::redo_now(const FrameKey& key, const std::string& worker_id) {
  std::vector<Unit> units;
  {
    FarmChange change(farm_);
    Job* job = change.find_job(key.job_id);
    if (job == nullptr || has_ended(job->state)) return;
    JobFilm& film = change.film(*job);
    film.finishing.erase(key.frame);
    if (job->plan->is_finished(key.frame)) {
      return doubt_frames(change, *job, {key.frame}, worker_id);
    }
    const BlockIndex& block_index = film.open_block_index(*job);
    bool has_any = false;
    for (const Unit& unit : block_index.units(key.frame)) {
      const bool is_theirs = block_index.worker(*block_index.find(unit)) == worker_id;
      has_any = has_any || is_theirs;
      const bool was_decided =
          job->plan->shape().is_adaptive && unit.pass >= job->plan->shape().first_passes();
      if (is_theirs || was_decided) units.push_back(unit);
    }
    if (!has_any) return finisher_.finish_if_complete(change, *job, key.frame);
  }
  finisher_.redo(key, units, true);
}

}  // namespace tessera::server
