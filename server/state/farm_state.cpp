#include "server/state/farm_state.h"

#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr char kStoreFull[] = "store full: ";  // begins the reason of a job that waits for room

EventKind event_kind(const Job& job) {
  switch (job.state) {
    case JobState::paused:
      return job.is_paused_by_failures() ? EventKind::job_paused_by_failures
                                         : EventKind::job_paused;
    case JobState::done:
      return EventKind::job_done;
    case JobState::failed:
      return EventKind::job_failed;
    case JobState::cancelled:
      return EventKind::job_cancelled;
    case JobState::queued:
      return EventKind::job_queued;
    case JobState::running:
      break;
  }
  return EventKind::job_running;
}

bool is_empty(const Effects& effects) {
  return effects.to_wake.empty() && effects.to_close.empty() && effects.to_close_unread.empty() &&
         effects.changed.empty() && effects.revised.empty() && effects.roster.empty() &&
         effects.audited.empty() && effects.faulty_workers.empty();
}

}  // namespace

FarmState::FarmState(const Store& store, FarmOptions options,
                     const std::vector<std::string>& roster)
    : options_(std::move(options)),
      events_(store.boot_count(), options_.wall_us),
      scheduler_({store.id(), store.key(), store.boot_count()}, options_.policy, roster,
                 options_.clock()),
      opened_(options_.clock()) {
  for (const QuotaKind& kind : kQuotaKinds) {
    options_.metrics->quota_refusals.Add({{"quota", kind.name}});
  }
}

void FarmState::log(LogLevel level, const std::string& message) const {
  if (options_.log) options_.log(level, message);
}

// Reading ----------------------------------------------------------------------------------------

FarmView::FarmView(const FarmState& farm) : farm_(farm) {
  farm_.mutex_.lock();
}

FarmView::~FarmView() {
  farm_.mutex_.unlock();
  for (const auto& call : calls_) call();
}

const Job* FarmView::find_job(const std::string& job_id) const {
  return scheduler().jobs().find(job_id);
}

const JobFilm& FarmView::film(const Job& job) const ABSL_NO_THREAD_SAFETY_ANALYSIS {
  return farm_.films_.at(job.key);
}

JobView FarmView::view(const Job& job) const {
  JobView view = film(job).view(job, now());
  view.pause_cause = pause_cause(job);
  if (view.reason.empty() && (job.state == JobState::queued || job.state == JobState::running)) {
    view.reason = scheduler().waiting().wait_text(job);
  }
  if (!view.reason.empty()) view.remaining_seconds.reset();  // a job that waits has no rate
  return view;
}

PauseCause FarmView::pause_cause(const Job& job) {
  if (job.state != JobState::paused) return PauseCause::none;
  if (job.is_paused_by_failures()) return PauseCause::failures;
  return FarmChange::waits_for_room(job) ? PauseCause::store_full : PauseCause::user;
}

JobRecord FarmView::record(const Job& job) const {
  return film(job).record(job, now());
}

OwnerUse FarmView::owner_use(const std::string& owner) const ABSL_NO_THREAD_SAFETY_ANALYSIS {
  const Demand demand = scheduler().jobs().demand(owner);
  OwnerUse use;
  use.jobs = demand.jobs;
  use.store_bytes = demand.store_bytes;
  use.samples = demand.samples;
  use.kept_bytes = static_cast<double>(farm_.kept_.of_owner(owner));
  return use;
}

void FarmView::log(LogLevel level, std::string message) {
  after_unlocking([&farm = farm_, level, text = std::move(message)] { farm.log(level, text); });
}

// Changing ---------------------------------------------------------------------------------------

FarmChange::FarmChange(FarmState& farm) : FarmView(farm), state_(farm) {}

FarmChange::~FarmChange() {
  settle();
}

/// Hands the scheduler's decisions to the parts, which may cause further ones.
void FarmChange::settle() {
  for (Effects effects = scheduler().take_effects(); !is_empty(effects);
       effects = scheduler().take_effects()) {
    for (EffectHandler* handler : state_.handlers_) handler->carry_out(*this, effects);
    for (const JobKey key : effects.changed) {
      const Job* job = scheduler().jobs().find(key);
      if (job != nullptr && !job->spec->is_unreadable) note_state(*job);
    }
  }
}

/// Notes a job's new state: event, log, time of its end.
void FarmChange::note_state(const Job& job) {
  note(event_kind(job), job, "", job.reason);
  log(job.state == JobState::failed || job.is_paused_by_failures() ? LogLevel::warn
                                                                   : LogLevel::info,
      absl::StrCat("job ", job.spec->id, " is ", state_name(job.state),
                   job.reason.empty() ? "" : ": ", job.reason));
  JobFilm& its_film = film(job);
  if (!has_ended(job.state)) {
    its_film.end_time_us = 0;
    set_end_served(job, std::nullopt);
  } else if (its_film.end_time_us == 0) {
    its_film.end_time_us = state_.options_.wall_us();
    set_end_served(job, served_us());
  }
  if (job.state == JobState::done) {  // its blocks are no longer needed
    its_film.grid.reset();
    its_film.block_index.reset();
    its_film.block_bytes = 0;
  }
  note_kept(job);
}

void FarmChange::note_kept(const Job& job) ABSL_NO_THREAD_SAFETY_ANALYSIS {
  const JobFilm& its_film = film(job);
  state_.kept_.set(job.key, job.spec->owner,
                   has_ended(job.state) ? its_film.image_bytes + its_film.block_bytes : 0);
}

Job* FarmChange::find_job(const std::string& job_id) {
  return scheduler().jobs().find(job_id);
}

JobFilm& FarmChange::film(const Job& job) ABSL_NO_THREAD_SAFETY_ANALYSIS {
  return state_.films_.at(job.key);
}

void FarmChange::set_end_served(const Job& job, std::optional<std::int64_t> served_us)
    ABSL_NO_THREAD_SAFETY_ANALYSIS {
  std::optional<std::int64_t>& end = film(job).end_served_us;
  if (end) state_.ended_.erase({*end, job.key});
  end = served_us;
  if (end) state_.ended_.insert({*end, job.key});
}

Job& FarmChange::add_job(JobKey key, std::shared_ptr<const JobSpec> spec,
                         JobState state) ABSL_NO_THREAD_SAFETY_ANALYSIS {
  state_.index_.add(key, *spec);
  state_.films_[key];
  Job& job = scheduler().changes().add_job(key, std::move(spec), state);
  note_demand(job);
  return job;
}

void FarmChange::note_demand(Job& job) {
  const JobSize size = max_job_size(*job.spec);
  scheduler().changes().set_demand(job, static_cast<double>(size.store_bytes), size.samples);
}

void FarmChange::remove_job(const Job& job) ABSL_NO_THREAD_SAFETY_ANALYSIS {
  const JobKey key = job.key;
  set_end_served(job, std::nullopt);
  state_.index_.remove(key, *job.spec);
  state_.kept_.remove(key);
  state_.films_.erase(key);
  scheduler().lifecycle().remove_job(key);
}

bool FarmChange::waits_for_room(const Job& job) {
  return job.state == JobState::paused && absl::StartsWith(job.reason, kStoreFull);
}

void FarmChange::pause_for_room(Job& job, const absl::Status& status) {
  if (job.state == JobState::paused) return;  // it resumes when who paused it wants
  scheduler()
      .lifecycle()
      .pause(job,
             absl::StrCat(kStoreFull, std::string(status.message()), "; the job resumes when ",
                          kRoomForJobs >> 20, " MiB are free"),
             now())
      .IgnoreError();
}

void FarmChange::note(EventKind kind, const Job& job, const std::string& worker_id,
                      const std::string& text) {
  state_.events_.add({0, 0, kind, job.spec->id, job.spec->owner, worker_id, text});
}

void FarmChange::note(EventKind kind, const std::string& worker_id, const std::string& text) {
  state_.events_.add({0, 0, kind, "", "", worker_id, text});
}

}  // namespace tessera::server
