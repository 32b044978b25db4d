#include "server/coordinator/coordinator.h"

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr std::int32_t kManyWorkers = 1000;  // above which heartbeats are halved
constexpr std::chrono::seconds kJournalRunningEvery{20}, kRetentionCheckPeriod{10};
constexpr std::size_t kOldJobsAtOnce = 16;

absl::Status no_such_job(const std::string& text) {
  return absl::NotFoundError(absl::StrCat("no job \"", text, "\""));
}

/// Returns whether `job` belongs to `owner`; an empty `owner` stands for all owners.
bool is_visible_to(const Job& job, const std::string& owner) {
  return owner.empty() || job.spec->owner == owner;
}

}  // namespace

Coordinator::Coordinator(Store& store, CoordinatorOptions options,
                         const std::vector<std::string>& roster)
    : store_(store),
      options_(std::move(options)),
      film_(options_.film_memory_bytes),
      events_(store.boot_count(), options_.wall_us),
      scheduler_({store.id(), store.key(), store.boot_count()}, options_.policy, roster,
                 options_.clock()) {}

Coordinator::~Coordinator() = default;

void Coordinator::log(LogLevel level, const std::string& message) const {
  if (options_.log) options_.log(level, message);
}

/// Carries out the scheduler's effects; calls of connections are deferred until the lock is
/// released.
void Coordinator::apply_effects(DeferredCalls& deferred) {
  Effects effects = scheduler_.take_effects();
  for (const WorkerKey key : effects.to_wake) {
    const auto connected = connections_.find(key);
    if (connected == connections_.end()) continue;
    deferred.add([connection = connected->second.connection] { connection->wake(); });
  }
  options_.metrics->errors.worker_lost.Increment(static_cast<double>(effects.to_close.size()));
  options_.metrics->audits_ended.Increment(static_cast<double>(effects.audited.size()));
  options_.metrics->workers_quarantined.Increment(
      static_cast<double>(effects.faulty_workers.size()));
  for (const WorkerKey key : effects.to_close_unread) {
    const auto connected = connections_.find(key);
    if (connected == connections_.end()) continue;
    deferred.add([connection = connected->second.connection] {
      connection->close(
          absl::ResourceExhaustedError("too many unread messages for this worker; reconnect"));
    });
    connections_.erase(connected);
  }
  for (const WorkerKey key : effects.to_close) {
    if (const Worker* worker = scheduler_.find_worker(key)) {
      note(EventKind::worker_lost, worker->id, "");
      deferred.add([this, id = worker->id] {
        log(LogLevel::warn, absl::StrCat("worker ", id, " is lost"));
      });
    }
    const auto connected = connections_.find(key);
    if (connected == connections_.end()) continue;
    deferred.add([connection = connected->second.connection] {
      connection->close(absl::UnavailableError("heartbeat timeout; reconnect"));
    });
    connections_.erase(connected);
    scheduler_.disconnect(key);
  }
  end_audits(effects.audited);
  for (const std::string& worker_id : effects.faulty_workers)
    quarantine_worker(worker_id, deferred);
  changed_.insert(effects.changed.begin(), effects.changed.end());
  roster_.insert(roster_.end(), effects.roster.begin(), effects.roster.end());
  if (!effects.changed.empty() || !effects.roster.empty()) writer_wakeup_.notify_all();
  for (const JobKey key : effects.changed) {
    const Job* job = scheduler_.find_job(key);
    if (job == nullptr) continue;
    note_state(*job);
    deferred.add([this, id = job->spec->id, state = job->state, reason = job->reason] {
      log(state == JobState::failed ? LogLevel::warn : LogLevel::info,
          absl::StrCat("job ", id, " is ", state_name(state), reason.empty() ? "" : ": ", reason));
    });
    JobFilm& film = job_film(*job);
    if (!has_ended(job->state)) {
      film.end_time_us = 0;
    } else if (film.end_time_us == 0) {
      film.end_time_us = options_.wall_us();
    }
    if (job->state == JobState::done) {  // its blocks are no longer needed
      film.grid.reset();
      film.block_index.reset();
    }
  }
}

void Coordinator::tick() {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  const Time now = options_.clock();
  scheduler_.tick(now, options_.tick_period);
  if (now - last_running_journal_ >= kJournalRunningEvery) {
    last_running_journal_ = now;
    journal_running();
  }
  if (options_.job_retention_us > 0 && now - last_retention_check_ >= kRetentionCheckPeriod) {
    last_retention_check_ = now;
    remove_old_jobs();
  }
  apply_effects(deferred);
}

/// Removes a few jobs at a time, so that the writer is not blocked.
void Coordinator::remove_old_jobs() {
  const std::int64_t ended_before_us = options_.wall_us() - options_.job_retention_us;
  std::size_t count = 0;
  for (const auto& [key, job] : scheduler_.jobs()) {
    const auto film = films_.find(key);
    if (film == films_.end()) continue;
    const std::int64_t ended_us = film->second.end_time_us;  // 0: not ended
    if (ended_us == 0 || ended_us > ended_before_us) continue;
    write_tasks_.emplace_back([this, id = job.spec->id] {
      remove_now(id, [this, id](const absl::Status& status) {
        if (status.ok())
          return log(LogLevel::info,
                     absl::StrCat("job ", id, " removed after its retention period"));
        // Removed or resumed by a request in the meantime.
        if (absl::IsNotFound(status) || absl::IsFailedPrecondition(status)) return;
        log(LogLevel::error,
            absl::StrCat("job ", id,
                         " cannot be removed after its retention period: ", status.ToString()));
      });
    });
    if (++count == kOldJobsAtOnce) break;
  }
  if (count > 0) writer_wakeup_.notify_all();
}

/// Journals the running time of jobs, and retries changes that could not be written.
void Coordinator::journal_running() {
  changed_.merge(unjournaled_);
  for (const auto& [key, job] : scheduler_.jobs()) {
    if (job.running_since) changed_.insert(key);
  }
  if (!changed_.empty()) writer_wakeup_.notify_all();
}

void Coordinator::stop() {
  MutexLock lock(mutex_);
  stopping_ = true;
  journal_running();
  writer_wakeup_.notify_all();
  film_wakeup_.notify_all();
}

bool Coordinator::is_stopping() const {
  MutexLock lock(mutex_);
  return stopping_;
}

// Workers ----------------------------------------------------------------------------------------

Coordinator::Joined Coordinator::join(const Hello& hello,
                                      std::shared_ptr<WorkerConnection> connection) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  const WorkerKey key = scheduler_.connect(hello, options_.clock());
  OpenConnection& connected = connections_[key];
  if (connected.connection) {
    deferred.add([old = connected.connection] {
      old->close(absl::AbortedError("replaced by a newer stream of this worker"));
    });
  }
  connected = {++last_session_, std::move(connection)};
  const std::string who = absl::StrCat(hello.name, " on ", hello.host, ", ", hello.isa, ", ",
                                       hello.thread_count, " threads");
  note(EventKind::worker_joined, hello.worker_id, who);
  deferred.add([this, text = absl::StrCat("worker ", hello.worker_id, " connected: ", who)] {
    log(LogLevel::info, text);
  });
  apply_effects(deferred);
  const bool many = static_cast<std::int32_t>(connections_.size()) > kManyWorkers;
  return {{key, connected.session},
          store_.id(),
          many ? 2000 : 1000,
          static_cast<std::int32_t>(seconds(options_.policy.worker_timeout) * 1000)};
}

Worker* Coordinator::session_worker(Session session) {
  const auto connected = connections_.find(session.worker);
  if (connected == connections_.end() || connected->second.session != session.number)
    return nullptr;
  Worker* worker = scheduler_.find_worker(session.worker);
  if (worker != nullptr) scheduler_.record_contact(session.worker, options_.clock());
  return worker;
}

void Coordinator::disconnect(Session session) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  const auto connected = connections_.find(session.worker);
  if (connected == connections_.end() || connected->second.session != session.number) return;
  // The connection may own the caller: it is destroyed after unlocking.
  deferred.add([connection = std::move(connected->second.connection)] {});
  connections_.erase(connected);
  scheduler_.disconnect(session.worker);
  apply_effects(deferred);
}

void Coordinator::record_contact(Session session) {
  MutexLock lock(mutex_);
  session_worker(session);
}

void Coordinator::heartbeat(Session session, const std::vector<UnitName>& started,
                            std::int64_t rss_bytes) {
  MutexLock lock(mutex_);
  if (session_worker(session) == nullptr) return;
  scheduler_.heartbeat(session.worker, started, rss_bytes, options_.clock());
}

void Coordinator::grant_credits(Session session, std::int32_t count) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  if (session_worker(session) == nullptr) return;
  scheduler_.grant_credits(session.worker, count, options_.clock());
  apply_effects(deferred);
}

void Coordinator::begin_draining(Session session) {
  MutexLock lock(mutex_);
  if (session_worker(session) != nullptr) scheduler_.begin_draining(session.worker);
}

void Coordinator::return_units(Session session, const std::vector<UnitName>& units) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  if (session_worker(session) == nullptr) return;
  scheduler_.return_units(session.worker, units, options_.clock());
  apply_effects(deferred);
}

void Coordinator::fail_unit(Session session, const Lease& lease, std::int32_t tile, Failure failure,
                            absl::StatusCode code) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  const Worker* worker = session_worker(session);
  if (worker == nullptr) return;
  options_.metrics->errors.unit_failed.Increment();
  const std::string unit =
      absl::StrCat("frame ", lease.frame, ", tile ", tile, ", pass ", lease.pass);
  const Job* job = scheduler_.find_job(lease.job_id);
  if (job != nullptr && job->ever_leased_to.count(worker->key) > 0) {
    note_failure(*job, worker->id, unit, failure);
  }
  deferred.add(
      [this, text = absl::StrCat("worker ", worker->id, ": job ", lease.job_id, ", ", unit,
                                 " failed: ", failure.message)] { log(LogLevel::warn, text); });
  scheduler_.fail_unit(session.worker, lease, tile, std::move(failure), code, options_.clock());
  apply_effects(deferred);
}

void Coordinator::scene_loaded(Session session, const std::string& job_id, const SceneLoad& load) {
  MutexLock lock(mutex_);
  if (session_worker(session) == nullptr) return;
  scheduler_.scene_loaded(session.worker, job_id, load);
}

Outbox Coordinator::take_outbox(Session session) {
  MutexLock lock(mutex_);
  const auto connected = connections_.find(session.worker);
  if (connected == connections_.end() || connected->second.session != session.number) return {};
  Worker* worker = scheduler_.find_worker(session.worker);
  return worker == nullptr ? Outbox{} : std::exchange(worker->outbox, Outbox{});
}

std::vector<std::pair<Worker, double>> Coordinator::workers() const {
  MutexLock lock(mutex_);
  const Time now = options_.clock();
  std::vector<std::pair<Worker, double>> workers;
  for (const auto& [key, worker] : scheduler_.workers()) {
    workers.emplace_back(worker, seconds(now - worker.last_contact));
  }
  return workers;
}

std::shared_ptr<const JobSpec> Coordinator::describe_job(const std::string& job_id,
                                                         const std::string& certificate) const {
  MutexLock lock(mutex_);
  const Job* job = scheduler_.find_job(job_id);
  if (job == nullptr) return nullptr;
  if (!certificate.empty() && scheduler_.leased_jobs(certificate).count(job->key) == 0) {
    return nullptr;
  }
  return job->spec;
}

bool Coordinator::is_leased_asset(const contract::Digest& digest,
                                  const std::string& certificate) const {
  MutexLock lock(mutex_);
  for (const JobKey key : scheduler_.leased_jobs(certificate)) {
    const Job& job = scheduler_.jobs().at(key);
    for (const ManifestEntry& entry : job.spec->assets) {
      if (entry.digest == digest) return true;
    }
  }
  return false;
}

void Coordinator::record_join(Join join, std::int64_t max_joins,
                              std::function<void(absl::Status)> done) {
  post_to_writer([this, join = std::move(join), max_joins, done = std::move(done)] {
    done(store_.record_join(join, max_joins));
  });
}

std::string Coordinator::session_key(const std::string& worker_id,
                                     const std::string& certificate) const {
  // Neither name contains the separator.
  return contract::hmac_sha256(store_.key(),
                               absl::StrCat("session\n", worker_id, "\n", certificate))
      .hex();
}

// Views ------------------------------------------------------------------------------------------

Coordinator::JobFilm& Coordinator::job_film(const Job& job) {
  return films_[job.key];
}

const contract::TileGrid& Coordinator::tile_grid(const Job& job) {
  JobFilm& film = job_film(job);
  if (!film.grid) film.grid = std::make_shared<const contract::TileGrid>(job.spec->settings);
  return *film.grid;
}

BlockIndex& Coordinator::open_block_index(Job& job) {
  JobFilm& film = job_film(job);
  if (!film.block_index) {
    const JobPlan& plan = job.open_plan();
    film.block_index.emplace(plan.tile_count(), static_cast<std::int32_t>(plan.passes().size()));
  }
  return *film.block_index;
}

/// Returns the samples of the whole job. With a target error they are predicted: frames not started
/// count as the mean of the others.
std::int64_t Coordinator::sample_count(const Job& job, const JobFilm& film) {
  const contract::RenderSettings& settings = job.spec->settings;
  const contract::PixelRect window = settings.window();
  const std::int64_t pixels = std::int64_t{window.width} * window.height;
  if (!settings.error) {
    return std::int64_t{job.frame_count} * pixels * contract::rounded_spp(settings.spp);
  }
  std::int64_t known = film.finished_samples;
  for (const auto& [frame, samples] : film.expected_samples) known += samples;
  const auto started =
      static_cast<std::int64_t>(film.finished.size() + film.expected_samples.size());
  const std::vector<contract::Pass> passes = contract::schedule(settings);
  const auto first =
      std::min(passes.size(), static_cast<std::size_t>(contract::kUnconditionalPasses)) - 1;
  const std::int64_t each = started > 0 ? known / started : pixels * passes[first].end();
  return known + (job.frame_count - started) * each;
}

JobView Coordinator::view(const Job& job) const {
  const auto found = films_.find(job.key);
  const JobFilm none;
  const JobFilm& film = found == films_.end() ? none : found->second;
  const Time now = options_.clock();
  JobView view;
  view.key = job.key;
  view.spec = job.spec;
  view.state = job.state;
  view.reason = job.reason;
  view.failure_code = job.failure_code;
  if (view.reason.empty() && (job.state == JobState::queued || job.state == JobState::running)) {
    view.reason = scheduler_.wait_text(job);
  }
  view.create_time_us = film.create_time_us;
  view.end_time_us = film.end_time_us;
  view.unit_count = job.plan ? job.plan->unit_count() : job.unit_count;
  view.frame_count = job.frame_count;
  if (job.plan) {
    view.committed_unit_count = job.plan->committed_count();
    view.leased_unit_count = job.plan->in_flight_count();
    view.finished_frame_count = job.plan->finished_frame_count();
  }
  view.committed_sample_count = film.committed_samples;
  view.sample_count = std::max(sample_count(job, film), film.committed_samples);
  if (job.state == JobState::done && job.spec->settings.error) view.certainty = film.certainty;
  view.worker_count = static_cast<std::int32_t>(job.holders.size());
  view.cpu_seconds = job.counters.cpu_seconds;
  view.estimated_error = film.estimated_error;
  view.elapsed_seconds = job.wall_seconds(now);
  const auto gained = static_cast<double>(film.committed_samples - film.samples_at_start);
  if (!has_ended(job.state) && gained > 0 && job.running_since) {
    const double spent = view.elapsed_seconds - film.wall_at_start;
    view.remaining_seconds =
        spent * static_cast<double>(view.sample_count - view.committed_sample_count) / gained;
  }
  return view;
}

JobRecord Coordinator::record(const Job& job) const {
  const JobView now = view(job);
  JobRecord record;
  record.id = job.spec->id;
  record.sequence = job.key;
  record.request_id = job.spec->request_id;
  record.name = job.spec->name;
  record.owner = job.spec->owner;
  record.request = job.spec->request;
  record.state = static_cast<std::int32_t>(job.state);
  record.reason = job.reason;
  record.failure_code = static_cast<std::int32_t>(job.failure_code);
  record.create_time_us = now.create_time_us;
  record.end_time_us = now.end_time_us;
  record.wall_seconds = now.elapsed_seconds;
  record.render_contract = job.spec->render_contract;
  return record;
}

absl::StatusOr<JobView> Coordinator::job(const std::string& job_id) const {
  MutexLock lock(mutex_);
  const Job* job = scheduler_.find_job(job_id);
  if (job == nullptr) return no_such_job(job_id);
  return view(*job);
}

absl::Status Coordinator::check_owner(const std::string& job_id, const std::string& owner) const {
  MutexLock lock(mutex_);
  const Job* job = scheduler_.find_job(job_id);
  return job != nullptr && is_visible_to(*job, owner) ? absl::OkStatus() : no_such_job(job_id);
}

absl::StatusOr<JobView> Coordinator::find_job(const std::string& text,
                                              const std::string& owner) const {
  MutexLock lock(mutex_);
  if (text.empty()) return no_such_job(text);
  const auto& jobs = scheduler_.jobs();
  std::vector<const Job*> fits;
  const Job* named = nullptr;
  for (auto it = jobs.rbegin(); it != jobs.rend(); ++it) {
    const Job& job = it->second;
    if (!is_visible_to(job, owner)) continue;
    if (text == "last" || job.spec->id == text) return view(job);
    if (absl::StartsWith(job.spec->id, text)) fits.push_back(&job);
    if (named == nullptr && job.spec->name == text) named = &job;
  }
  if (fits.size() == 1) return view(*fits.front());
  if (named != nullptr) return view(*named);
  if (fits.empty()) return no_such_job(text);
  std::string message = absl::StrCat("\"", text, "\" matches several jobs:");
  for (const Job* job : fits) absl::StrAppend(&message, " ", job->spec->id);
  return absl::InvalidArgumentError(message);
}

std::vector<JobView> Coordinator::list_jobs(JobKey before, std::int32_t limit,
                                            const std::string& owner) const {
  MutexLock lock(mutex_);
  const auto& jobs = scheduler_.jobs();
  auto job = before > 0 ? std::make_reverse_iterator(jobs.lower_bound(before)) : jobs.rbegin();
  std::vector<JobView> views;
  for (; job != jobs.rend() && static_cast<std::int32_t>(views.size()) < limit; ++job) {
    if (is_visible_to(job->second, owner)) views.push_back(view(job->second));
  }
  return views;
}

absl::StatusOr<JobReport> Coordinator::report(const std::string& job_id) const {
  MutexLock lock(mutex_);
  const Job* job = scheduler_.find_job(job_id);
  if (job == nullptr) return no_such_job(job_id);
  JobReport report;
  report.view = view(*job);
  report.counters = job->counters;
  report.contributions = job->contributions;
  if (const auto film = films_.find(job->key); film != films_.end()) {
    report.warnings = film->second.warnings;
  }
  for (const auto& [key, worker] : scheduler_.workers()) {
    if (report.contributions.count(worker.id) == 0) continue;
    report.machines[worker.id] = {worker.isa, worker.thread_count};
  }
  if (const auto film = films_.find(job->key); film != films_.end()) {
    for (const auto& [frame, finished] : film->second.finished) report.frames.push_back(finished);
  }
  return report;
}

}  // namespace tessera::server
