#include "server/frames/audit_outcomes.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/film/frame_summary.h"

namespace tessera::server {

using contract::Unit;

namespace {

std::string suspect_frame_warning(std::int32_t frame, const std::string& worker_id) {
  return absl::StrCat("frame ", frame, " may contain wrong pixels: it was finished before worker ",
                      worker_id, ", which rendered part of the job, was quarantined");
}

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Returns the units of a frame to render again: those of the workers, and those that were decided
/// on because of them; none if there are none of the workers.
std::vector<Unit> units_to_drop(const BlockIndex& blocks, const PlanShape& shape,
                                std::int32_t frame, const std::vector<std::string>& workers) {
  std::vector<Unit> units;
  bool has_any = false;
  for (const Unit& unit : blocks.units(frame)) {
    const bool is_theirs = contains(workers, blocks.worker(*blocks.find(unit)));
    const bool was_decided = shape.is_adaptive && unit.pass >= shape.first_passes();
    has_any = has_any || is_theirs;
    if (is_theirs || was_decided) units.push_back(unit);
  }
  return has_any ? units : std::vector<Unit>();
}

}  // namespace

void AuditOutcomes::carry_out(FarmChange& change, const Effects& effects) {
  farm_.metrics().audits_ended.Increment(static_cast<double>(effects.audited.size()));
  farm_.metrics().workers_quarantined.Increment(static_cast<double>(effects.faulty_workers.size()));
  if (effects.faulty_workers.empty()) {
    for (const UnitName& unit : effects.audited) end_audit(change, unit);
    return;
  }
  for (const std::string& worker_id : effects.faulty_workers) quarantine(change, worker_id);
  {
    const MutexLock lock(mutex_);
    pending_.faulty.insert(pending_.faulty.end(), effects.faulty_workers.begin(),
                           effects.faulty_workers.end());
    pending_.audited.insert(pending_.audited.end(), effects.audited.begin(), effects.audited.end());
  }
  // After all answers so far, which may be about units of these workers.
  pipeline_.post([this] { settle(); });
}

void AuditOutcomes::end_audit(FarmChange& change, const UnitName& unit) {
  pipeline_.post_write(
      [this, unit] {
        return store_.units().set_audits(unit.job_id, {unit.unit}, AuditState::ended);
      },
      [this](const absl::Status& status) {
        if (!status.ok()) farm_.log(LogLevel::error, absl::StrCat("audits: ", status.ToString()));
      });
  Job* job = change.find_job(unit.job_id);
  if (job != nullptr) finisher_.finish_if_complete(change, *job, unit.unit.frame);
}

/// Holds the unfinished frames that may contain units of a faulty worker.
void AuditOutcomes::quarantine(FarmChange& change, const std::string& worker_id) {
  change.log(LogLevel::error,
             absl::StrCat("worker ", worker_id, " quarantined: delivered wrong pixels"));
  for (const auto& [key, job] : change.scheduler().jobs().all()) {
    if (job.contributions.count(worker_id) == 0 || !job.plan) continue;
    JobFilm& film = change.film(job);
    if (!film.block_index) continue;
    for (const std::int32_t frame : job.plan->shape().frames) {
      if (job.plan->is_finished(frame) || !film.block_index->has(frame)) continue;
      film.suspect.insert(frame);
    }
  }
}

void AuditOutcomes::note_late_unit(FarmChange& change, const Job& job, std::int32_t frame,
                                   const std::string& worker_id) {
  const MutexLock lock(mutex_);
  if (contains(pending_.faulty, worker_id)) change.film(job).suspect.insert(frame);
}

void AuditOutcomes::tick() {
  const MutexLock lock(mutex_);
  if (is_postponed_) pipeline_.post([this] { settle(); });
}

// On the writer thread ----------------------------------------------------------------------------

/// Writes the verdicts reached so far, then carries them out.
void AuditOutcomes::settle() {
  Verdict verdict;
  {
    const MutexLock lock(mutex_);
    verdict = pending_;  // it stays until it is carried out, for note_late_unit()
  }
  if (verdict.faulty.empty()) return;
  std::vector<Consequence> consequences = find_consequences(verdict);
  const absl::Status status = pipeline_.write_apart([&] { return write(verdict, consequences); });
  if (!status.ok()) return postpone(consequences, status);
  for (const Consequence& consequence : consequences) apply(consequence);
  FarmChange change(farm_);
  {
    const MutexLock lock(mutex_);
    is_postponed_ = false;
    pending_.faulty.erase(pending_.faulty.begin(),
                          pending_.faulty.begin() + std::ssize(verdict.faulty));
    pending_.audited.erase(pending_.audited.begin(),
                           pending_.audited.begin() + std::ssize(verdict.audited));
    if (!pending_.faulty.empty()) return;  // another verdict, about which a task follows
  }
  for (const Consequence& consequence : consequences) {
    if (consequence.status.ok()) release_frames(change, consequence.key);
  }
  for (const UnitName& unit : verdict.audited) {
    Job* job = change.find_job(unit.job_id);
    if (job != nullptr) finisher_.finish_if_complete(change, *job, unit.unit.frame);
  }
}

std::vector<AuditOutcomes::Consequence> AuditOutcomes::find_consequences(const Verdict& verdict) {
  std::vector<Consequence> found;
  FarmChange change(farm_);
  for (const auto& [key, job] : change.scheduler().jobs().all()) {
    JobFilm& film = change.film(job);
    Consequence consequence{key, job.spec->id, {}, {}, {}};
    for (const std::int32_t frame : film.suspect) {
      if (job.plan->is_finished(frame) || !film.block_index) continue;
      consequence.dropped[frame] =
          units_to_drop(*film.block_index, job.plan->shape(), frame, verdict.faulty);
    }
    for (const std::string& worker_id : verdict.faulty) {
      if (job.contributions.count(worker_id) == 0) continue;
      for (const auto& [frame, record] : film.finished) {
        consequence.doubts[frame].push_back(suspect_frame_warning(frame, worker_id));
      }
    }
    if (film.suspect.empty() && consequence.doubts.empty()) continue;
    found.push_back(std::move(consequence));
  }
  return found;
}

/// Writes everything that follows from a verdict. Errors: ResourceExhausted, the disk is full; then
/// the bans are not among what was written. Other errors concern one job each and are noted there.
absl::Status AuditOutcomes::write(const Verdict& verdict, std::vector<Consequence>& consequences) {
  for (Consequence& consequence : consequences) {
    consequence.status = write_job(consequence);
    if (absl::IsResourceExhausted(consequence.status)) return consequence.status;
  }
  absl::Status status;
  for (const UnitName& unit : verdict.audited) {
    const absl::Status ended =
        store_.units().set_audits(unit.job_id, {unit.unit}, AuditState::ended);
    if (!absl::IsNotFound(ended)) status.Update(ended);  // its job may have been removed
  }
  for (const auto& [worker_id, names] : names_to_ban(verdict)) {
    for (const std::string& name : names) status.Update(store_.workers().ban_worker(name));
    pipeline_.tell(
        {0, 0, EventKind::worker_quarantined, "", "", worker_id, "delivered wrong pixels"});
  }
  return status;
}

/// Returns the names to ban by worker.
std::map<std::string, std::vector<std::string>> AuditOutcomes::names_to_ban(
    const Verdict& verdict) const {
  std::map<std::string, std::vector<std::string>> names;
  const FarmView view(farm_);
  for (const std::string& id : verdict.faulty) {
    names[id] = view.scheduler().quarantine().names_to_ban(id);
  }
  return names;
}

/// Drops units of a job, and adds warnings to the rows of its finished frames.
absl::Status AuditOutcomes::write_job(const Consequence& consequence) {
  std::vector<Unit> units;
  for (const auto& [frame, dropped] : consequence.dropped) {
    units.insert(units.end(), dropped.begin(), dropped.end());
  }
  if (!units.empty()) {
    absl::Status dropped = store_.units().drop(consequence.job_id, units);
    if (!dropped.ok()) return dropped;
  }
  if (consequence.doubts.empty()) return absl::OkStatus();
  const auto rows = store_.frames().list(consequence.job_id);
  if (!rows.ok()) return rows.status();
  for (const FrameRecord& row : *rows) {
    const auto doubts = consequence.doubts.find(row.frame);
    if (doubts == consequence.doubts.end()) continue;
    FrameSummary summary = read_frame_summary(row.statistics_json);
    for (const std::string& doubt : doubts->second) {
      if (!contains(summary.doubts, doubt)) summary.doubts.push_back(doubt);
    }
    absl::Status written = store_.frames().update_statistics(consequence.job_id, row.frame,
                                                             write_frame_summary(summary));
    if (!written.ok()) return written;
  }
  return absl::OkStatus();
}

/// Has dropped units rendered again.
void AuditOutcomes::apply(const Consequence& consequence) {
  if (!consequence.status.ok()) {
    FarmChange change(farm_);
    Job* job = change.scheduler().jobs().find(consequence.key);
    if (job == nullptr || has_ended(job->state)) return;
    return change.scheduler().lifecycle().fail_job(*job, consequence.status, change.now());
  }
  for (const auto& [frame, units] : consequence.dropped) {
    if (!units.empty()) finisher_.forget({consequence.job_id, frame}, units, true);
  }
  FarmChange change(farm_);
  Job* job = change.scheduler().jobs().find(consequence.key);
  if (job == nullptr) return;
  JobFilm& film = change.film(*job);
  for (const auto& [frame, doubts] : consequence.doubts) {
    film.warnings.insert(film.warnings.end(), doubts.begin(), doubts.end());
  }
}

/// Lets the frames of a job be finished that contain no units of faulty workers any more.
void AuditOutcomes::release_frames(FarmChange& change, JobKey key) {
  Job* job = change.scheduler().jobs().find(key);
  if (job == nullptr) return;
  const std::set<std::int32_t> frames = std::exchange(change.film(*job).suspect, {});
  for (const std::int32_t frame : frames) finisher_.finish_if_complete(change, *job, frame);
}

/// Pauses the jobs concerned until the disk has room; tick() tries again.
void AuditOutcomes::postpone(const std::vector<Consequence>& consequences,
                             const absl::Status& status) {
  {
    const MutexLock lock(mutex_);
    if (!std::exchange(is_postponed_, true)) {
      farm_.log(LogLevel::error, absl::StrCat("quarantine: ", status.ToString()));
    }
  }
  if (!absl::IsResourceExhausted(status)) return;
  FarmChange change(farm_);
  for (const Consequence& consequence : consequences) {
    Job* job = change.scheduler().jobs().find(consequence.key);
    if (job != nullptr && !consequence.dropped.empty()) change.pause_for_room(*job, status);
  }
}

}  // namespace tessera::server
