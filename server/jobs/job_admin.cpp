#include "server/jobs/job_admin.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/pass_schedule.h"
#include "contract/version.h"
#include "server/jobs/job_admission.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr std::chrono::seconds kCheckPeriod{10};
constexpr std::size_t kOldJobsAtOnce = 64;
constexpr std::size_t kMaxBlockedWorkers = 1000;

absl::Status no_such_job(const std::string& job_id) {
  return absl::NotFoundError(absl::StrCat("no job \"", job_id, "\""));
}

absl::StatusOr<JobView> view_of(const FarmState& farm, const std::string& job_id) {
  const FarmView view(farm);
  const Job* job = view.find_job(job_id);
  if (job == nullptr) return no_such_job(job_id);
  return view.view(*job);
}

absl::Status not_recorded(const absl::Status& status) {
  return {
      status.code(),
      absl::StrCat("the change is in effect but could not be recorded, so a restart undoes it: ",
                   std::string(status.message()))};
}

/// Errors: InvalidArgument, the extension is shorter than `present` or out of range.
absl::Status check_extension(const contract::RenderSettings& present,
                             const JobAdmin::Extension& extension) {
  const std::int32_t spp = extension.spp.value_or(present.spp);
  if (spp < present.spp || spp > contract::kMaxSpp) {
    return absl::InvalidArgumentError(absl::StrCat("sample_count: ", spp, " is not in [",
                                                   present.spp, ", ", contract::kMaxSpp, "]"));
  }
  if (extension.error && !(*extension.error > 0 && *extension.error <= present.error.value_or(1))) {
    return absl::InvalidArgumentError(absl::StrCat(
        "error_target: ", *extension.error, " is not in (0, ", present.error.value_or(1), "]"));
  }
  return absl::OkStatus();
}

void apply_update(const JobAdmin::Update& update, JobSpec& spec) {
  if (update.priority) spec.priority = *update.priority;
  if (update.max_workers) spec.max_workers = *update.max_workers;
  if (update.required_tag) spec.required_tag = *update.required_tag;
  if (update.pool) spec.pool = *update.pool;
  if (update.limits) spec.limits = *update.limits;
  if (update.clear_dependencies) spec.after.clear();
  spec.blocked_workers.insert(update.block_workers.begin(), update.block_workers.end());
  for (const std::string& worker : update.unblock_workers) spec.blocked_workers.erase(worker);
}

/// Returns what update_job() can change, for events and the log.
std::string describe(const JobSpec& spec) {
  std::string text = absl::StrCat("priority ", spec.priority, ", ");
  if (spec.max_workers > 0) absl::StrAppend(&text, "at most ", spec.max_workers, " workers, ");
  absl::StrAppend(&text, "pool ", spec.pool.empty() ? kDefaultPool : spec.pool);
  if (!spec.required_tag.empty()) absl::StrAppend(&text, ", tag ", spec.required_tag);
  for (const LimitUse& use : spec.limits) {
    absl::StrAppend(&text, ", limit ", use.limit, "=", use.units);
  }
  for (const Dependency& dependency : spec.after) {
    absl::StrAppend(&text, ", after job ", dependency.job_id);
  }
  for (const std::string& worker : spec.blocked_workers) {
    absl::StrAppend(&text, ", not on worker ", worker);
  }
  return text;
}

}  // namespace

absl::Status check_readable(const JobSpec& spec) {
  if (!spec.is_unreadable) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("job ", spec.id, " cannot be read, only removed; submit it again"));
}

absl::Status check_render_contract(const JobSpec& spec) {
  if (spec.render_contract == contract::kRenderContract) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("job ", spec.id, " uses render contract ", spec.render_contract,
                   ", this server ", contract::kRenderContract, "; submit the job again"));
}

// Changes ----------------------------------------------------------------------------------------

void JobAdmin::change_job(const std::string& job_id, Change what, const OnJob& done) {
  if (what != Change::retry) return change_now(job_id, what, done);
  // A retry counts against the quotas. On the writer thread all jobs that are being created are
  // counted too: their rows are not written, or they are in the farm.
  pipeline_.post([this, job_id, done] { change_now(job_id, Change::retry, done); });
}

void JobAdmin::change_now(const std::string& job_id, Change what, const OnJob& done) {
  FarmChange change(farm_);
  Job* job = change.find_job(job_id);
  const absl::Status status = job == nullptr ? no_such_job(job_id) : apply(change, *job, what);
  if (!status.ok()) return change.after_unlocking([done, status] { done(status); });
  const auto answer = [this, job_id, done](const absl::Status& written) {
    done(written.ok() ? view_of(farm_, job_id) : not_recorded(written));
  };
  pipeline_.answer_when_written(change, job->key, answer);
}

absl::Status JobAdmin::apply(FarmChange& change, Job& job, Change what) {
  Scheduler& scheduler = change.scheduler();
  absl::Status status;
  switch (what) {
    case Change::pause:
      return scheduler.lifecycle().pause(job, "paused by the user", change.now());
    case Change::cancel:
      return scheduler.lifecycle().cancel(job, change.now());
    case Change::resume:
      status = scheduler.lifecycle().resume(job, change.now());
      break;
    case Change::retry:
      if (FarmView::pause_cause(job) == PauseCause::user) {
        return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id,
                                                          " was paused by a user; `tessera resume ",
                                                          job.spec->id, "` resumes it"));
      }
      status = check_readable(*job.spec);
      status.Update(check_render_contract(*job.spec));
      status.Update(check_owners_quota(change, *job.spec, assets_use(job.spec->owner)));
      if (status.ok()) status = scheduler.lifecycle().retry(job, change.now());
      break;
  }
  if (status.ok()) finisher_.catch_up(change, job);
  return status;
}

// Extension --------------------------------------------------------------------------------------

void JobAdmin::extend_job(const std::string& job_id, const Extension& extension, OnJob done) {
  pipeline_.post(
      [this, job_id, extension, done = std::move(done)] { done(extend_now(job_id, extension)); });
}

/// Returns the spec of the extended job, if it can be extended. On the writer thread.
absl::StatusOr<std::shared_ptr<JobSpec>> JobAdmin::spec_to_extend(
    const std::string& job_id, const Extension& extension) const {
  const FarmView view(farm_);
  const Job* job = view.find_job(job_id);
  if (job == nullptr) return no_such_job(job_id);
  if (job->state == JobState::done) {
    return absl::FailedPreconditionError(
        absl::StrCat("job ", job_id, " is done and its blocks are deleted; submit a new job"));
  }
  absl::Status status = check_readable(*job->spec);
  status.Update(check_render_contract(*job->spec));
  if (status.ok()) status = check_extension(job->spec->settings, extension);
  if (!status.ok()) return status;
  auto spec = std::make_shared<JobSpec>(*job->spec);
  // The samples that exist, and the frames that renderers have loaded, are guided or not.
  spec->settings.guiding = spec->settings.is_guided();
  if (extension.spp) spec->settings.spp = *extension.spp;
  if (extension.error) spec->settings.error = extension.error;
  status = check_owners_quota(view, *spec, assets_use(spec->owner));
  if (!status.ok()) return status;
  return spec;
}

/// Drops units that the longer schedule does not have and writes the new request in one
/// transaction, then changes the plan: a block does not name its samples, so rows and units must
/// never disagree. On the writer thread, which commits nothing meanwhile.
absl::StatusOr<JobView> JobAdmin::extend_now(const std::string& job_id,
                                             const Extension& extension) {
  const auto found = spec_to_extend(job_id, extension);
  if (!found.ok()) return found.status();
  const std::shared_ptr<JobSpec>& spec = *found;
  contract::RenderSettings present;
  JobRecord record;
  {
    const FarmView view(farm_);
    const Job& job = *view.find_job(job_id);
    present = job.spec->settings;
    record = view.record(job);
    if (spec->settings.spp == present.spp && spec->settings.error == present.error) {
      return view.view(job);
    }
  }
  const std::vector<contract::Pass> before = contract::schedule(present);
  const std::vector<contract::Pass> after = contract::schedule(spec->settings);
  // Those of faulty workers may be in finished frames, which are finished again now.
  std::vector<Unit> dropped, faulty;
  std::vector<UnitRecord> units, kept;
  absl::Status status =
      store_.units().for_each(job_id, [&](const UnitRecord& unit) { units.push_back(unit); });
  if (!status.ok()) return status;
  {
    const FarmView view(farm_);
    const Quarantine& quarantine = view.scheduler().quarantine();
    for (const UnitRecord& unit : units) {
      const auto pass = static_cast<std::size_t>(unit.unit.pass);
      const bool is_same =
          pass < before.size() && pass < after.size() && before[pass] == after[pass];
      const bool is_faulty = quarantine.is_quarantined(unit.worker_id);
      if (is_same && !is_faulty) {
        kept.push_back(unit);
      } else {
        dropped.push_back(unit.unit);
      }
      if (is_same && is_faulty) faulty.push_back(unit.unit);
    }
  }
  spec->request = record.request = farm_.options().write_request(*spec);
  status = store_.jobs().rewrite(record, dropped);
  if (!status.ok()) return status;
  return replan(job_id, spec, kept, faulty);
}

/// Restarts a job with new settings, keeping the units that remain valid. `redone`: units of the
/// same passes that do not.
JobView JobAdmin::replan(const std::string& job_id, const std::shared_ptr<const JobSpec>& spec,
                         const std::vector<UnitRecord>& kept, const std::vector<Unit>& redone) {
  FarmChange change(farm_);
  Job& job = *change.find_job(job_id);  // only this thread removes jobs
  JobFilm& film = change.film(job);
  change.scheduler().changes().extend(job, spec);
  change.note_demand(job);
  film.reset();
  for (const Unit& unit : redone) change.scheduler().results().redo(job, unit);
  for (const UnitRecord& record : kept) {
    change.scheduler().results().restore_unit(job, record.unit, record.worker_id,
                                              record.cpu_seconds);
    film.open_block_index(job).add(record, job.wall_seconds(change.now()));
    if (record.audit == AuditState::open) {
      change.scheduler().audits().open_audit(job, record.unit, record.worker_id, record.sha256);
    }
    film.committed_samples += film.unit_samples(job, record.unit);
  }
  film.samples_at_start = film.committed_samples;
  film.wall_at_start = job.wall_seconds(change.now());
  finisher_.close_frames(job);
  if (!has_ended(job.state)) finisher_.catch_up(change, job);
  change.scheduler().dispatcher().dispatch_all(change.now());
  return change.view(job);
}

// Order, requirements, limits ---------------------------------------------------------------------

void JobAdmin::update_job(const std::string& job_id, const Update& update, OnJob done) {
  pipeline_.post(
      [this, job_id, update, done = std::move(done)] { done(update_now(job_id, update)); });
}

/// Writes the new request, then changes the schedule. On the writer thread, which writes no row of
/// the job meanwhile.
absl::StatusOr<JobView> JobAdmin::update_now(const std::string& job_id, const Update& update) {
  std::shared_ptr<JobSpec> spec;
  JobRecord record;
  {
    const FarmView view(farm_);
    const Job* job = view.find_job(job_id);
    if (job == nullptr) return no_such_job(job_id);
    if (job->state == JobState::done) {
      return absl::FailedPreconditionError(absl::StrCat("job ", job_id, " is done"));
    }
    if (absl::Status readable = check_readable(*job->spec); !readable.ok()) return readable;
    spec = std::make_shared<JobSpec>(*job->spec);
    apply_update(update, *spec);
    absl::Status exist = check_limits_exist(view, update.limits.value_or(std::vector<LimitUse>{}));
    if (!exist.ok()) return exist;
    if (spec->blocked_workers.size() > kMaxBlockedWorkers) {
      return absl::ResourceExhaustedError(
          absl::StrCat("job ", job_id, " has ", kMaxBlockedWorkers, " blocked workers already"));
    }
    spec->request = farm_.options().write_request(*spec);
    if (spec->request == job->spec->request) return view.view(*job);
    record = view.record(*job);
  }
  record.request = spec->request;
  const Event event{0, 0, EventKind::job_changed, job_id, spec->owner, "", describe(*spec)};
  const absl::Status written =
      pipeline_.write_and_tell([&] { return store_.jobs().rewrite(record, {}); }, event);
  if (!written.ok()) return written;
  FarmChange change(farm_);
  Job& job = *change.find_job(job_id);  // only this thread removes jobs
  change.scheduler().changes().change(job, spec, change.now());
  change.log(LogLevel::info, absl::StrCat("job ", job_id, " changed: ", describe(*spec)));
  return change.view(job);
}

// Removal ----------------------------------------------------------------------------------------

void JobAdmin::remove_job(const std::string& job_id, std::function<void(absl::Status)> done) {
  pipeline_.post([this, job_id, done = std::move(done)] { done(remove_now({job_id}).front()); });
}

/// Returns the event of a job's removal. Errors: NotFound; FailedPrecondition, it has not ended.
absl::StatusOr<Event> JobAdmin::removal_of(const std::string& job_id) const {
  const FarmView view(farm_);
  const Job* job = view.find_job(job_id);
  if (job == nullptr) return no_such_job(job_id);
  if (!has_ended(job->state)) {
    return absl::FailedPreconditionError(
        absl::StrCat("job ", job_id, " has not ended; cancel it first"));
  }
  return Event{0, 0, EventKind::job_removed, job_id, job->spec->owner, "", ""};
}

/// Removes the rows in one transaction, then the jobs in memory: one whose rows cannot be written
/// stays listed. Returns the outcome of each.
std::vector<absl::Status> JobAdmin::remove_now(const std::vector<std::string>& job_ids) {
  // Before the transaction, in which nothing should wait for the farm's lock. Only this thread
  // removes or retries jobs, so that they stay ended.
  std::vector<absl::StatusOr<Event>> events;
  events.reserve(job_ids.size());
  for (const std::string& job_id : job_ids) events.push_back(removal_of(job_id));
  std::vector<absl::Status> outcomes(job_ids.size());
  const absl::Status together = pipeline_.write_apart([&] {
    for (std::size_t i = 0; i < job_ids.size(); ++i) {
      outcomes[i] = events[i].ok() ? store_.jobs().remove(job_ids[i]) : events[i].status();
      if (outcomes[i].ok()) pipeline_.tell(*events[i]);
    }
    return absl::OkStatus();
  });
  std::map<JobKey, std::shared_ptr<const JobSpec>> removed;
  for (std::size_t i = 0; i < job_ids.size(); ++i) {
    outcomes[i].Update(together);
    if (!outcomes[i].ok()) continue;
    FarmChange change(farm_);
    const JobKey key = change.find_job(job_ids[i])->key;  // only this thread removes jobs
    removed[key] = forget(change, job_ids[i]);
  }
  // The jobs are gone, whether or not the time at which their assets were last used can be written.
  if (!removed.empty()) assets_.release(removed).IgnoreError();
  return outcomes;
}

/// Removes a job in memory and returns its spec.
std::shared_ptr<const JobSpec> JobAdmin::forget(FarmChange& change, const std::string& job_id) {
  Job& job = *change.find_job(job_id);
  std::shared_ptr<const JobSpec> spec = job.spec;
  finisher_.close_frames(job);
  change.remove_job(job);
  return spec;
}

void JobAdmin::tick(FarmChange& change) {
  const bool is_due = change.now() - last_tick_ >= kCheckPeriod;
  if (!is_due) return;
  if (!is_expiring_) expire_jobs(change);
  last_tick_ = change.now();
  const JobTable& jobs = change.scheduler().jobs();
  const std::set<JobKey>& paused = jobs.of_state(JobState::paused);
  has_waiting_ = std::any_of(paused.begin(), paused.end(),
                             [&](JobKey key) { return FarmChange::waits_for_room(jobs.at(key)); });
  if (has_waiting_) pipeline_.post([this] { resume_waiting(); });
}

/// Resumes the jobs that wait for room, if there is some. On the writer thread.
void JobAdmin::resume_waiting() {
  if (store_.free_bytes() < kRoomForJobs) return;
  FarmChange change(farm_);
  std::vector<Job*> waiting;
  for (const JobKey key : change.scheduler().jobs().of_state(JobState::paused)) {
    Job* job = change.scheduler().jobs().find(key);
    if (FarmChange::waits_for_room(*job)) waiting.push_back(job);
  }
  for (Job* job : waiting) apply(change, *job, Change::resume).IgnoreError();  // none has ended
}

/// Removes a few jobs at a time, so that other writes need not wait long; the writer goes on with
/// more after these. Otherwise a farm of small jobs would grow for ever.
void JobAdmin::expire_jobs(FarmChange& change) {
  const FarmOptions& options = farm_.options();
  if (options.job_retention_us <= 0) return;
  std::vector<std::string> job_ids;
  for (const auto& [ended_us, key] : change.ended_jobs()) {
    const bool is_old = change.served_us() - ended_us >= options.job_retention_us;
    if (!is_old || job_ids.size() == kOldJobsAtOnce) break;
    job_ids.push_back(change.scheduler().jobs().at(key).spec->id);
  }
  is_expiring_ = !job_ids.empty();
  if (is_expiring_) pipeline_.post([this, job_ids = std::move(job_ids)] { expire(job_ids); });
}

void JobAdmin::expire(const std::vector<std::string>& job_ids) {
  const std::vector<absl::Status> outcomes = remove_now(job_ids);
  bool has_failed = false;
  for (std::size_t i = 0; i < job_ids.size(); ++i) {
    const absl::Status& status = outcomes[i];
    if (status.ok()) {
      farm_.log(LogLevel::info,
                absl::StrCat("job ", job_ids[i], " removed after its retention period"));
      continue;
    }
    // Removed or resumed by a request in the meantime.
    if (absl::IsNotFound(status) || absl::IsFailedPrecondition(status)) continue;
    has_failed = true;
    farm_.log(LogLevel::error,
              absl::StrCat("job ", job_ids[i],
                           " cannot be removed after its retention period: ", status.ToString()));
  }
  FarmChange change(farm_);
  is_expiring_ = false;
  if (!has_failed && job_ids.size() == kOldJobsAtOnce) expire_jobs(change);
}

}  // namespace tessera::server
