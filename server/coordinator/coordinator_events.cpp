// Events and operator commands.
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/coordinator/coordinator.h"

namespace tessera::server {
namespace {

EventKind event_kind(JobState state) {
  switch (state) {
    case JobState::paused:
      return EventKind::job_paused;
    case JobState::done:
      return EventKind::job_done;
    case JobState::failed:
      return EventKind::job_failed;
    case JobState::cancelled:
      return EventKind::job_cancelled;
    case JobState::queued:
    case JobState::running:
      break;
  }
  return EventKind::job_running;
}

absl::Status no_such_worker(const std::string& worker_id) {
  return absl::NotFoundError(absl::StrCat("no worker \"", worker_id, "\""));
}

}  // namespace

void Coordinator::note(EventKind kind, const Job& job, const std::string& worker_id,
                       const std::string& text) {
  events_.add({0, 0, kind, job.spec->id, job.spec->owner, worker_id, text});
}

void Coordinator::note(EventKind kind, const std::string& worker_id, const std::string& text) {
  events_.add({0, 0, kind, "", "", worker_id, text});
}

void Coordinator::note_state(const Job& job) {
  if (job.state != JobState::queued) note(event_kind(job.state), job, "", job.reason);
}

void Coordinator::note_failure(const Job& job, const std::string& worker_id,
                               const std::string& what, const Failure& failure) {
  note(EventKind::unit_failed, job, worker_id, absl::StrCat(what, " failed: ", failure.message));
  for (const absl::string_view line : absl::StrSplit(failure.log_tail, '\n', absl::SkipEmpty())) {
    note(EventKind::log_line, job, worker_id, absl::StrCat("renderer: ", std::string(line)));
  }
}

absl::StatusOr<std::vector<Delivery>> Coordinator::deliveries(const std::string& job_id,
                                                              std::int64_t after,
                                                              std::size_t limit) const {
  JobKey key = 0;
  {
    MutexLock lock(mutex_);
    const Job* job = scheduler_.find_job(job_id);
    if (job == nullptr) return absl::NotFoundError(absl::StrCat("no job \"", job_id, "\""));
    key = job->key;
  }
  return deliveries_.read(key, after, limit);
}

void Coordinator::take_log_lines(Session session, const std::vector<LogLine>& lines) {
  MutexLock lock(mutex_);
  const Worker* worker = session_worker(session);
  if (worker == nullptr) return;
  for (const LogLine& line : lines) {
    const Job* job = scheduler_.find_job(line.job_id);
    if (job == nullptr) continue;
    // Also for a job that has ended: its last lines arrive late.
    const bool took_part =
        job->ever_leased_to.count(worker->key) + job->contributions.count(worker->id) > 0;
    if (!took_part) continue;
    note(EventKind::log_line, *job, worker->id, line.text);
  }
}

absl::Status Coordinator::drain_worker(const std::string& worker_id) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  if (!scheduler_.drain(worker_id)) return no_such_worker(worker_id);
  note(EventKind::worker_drained, worker_id, "");
  deferred.add([this, worker_id] {
    log(LogLevel::info, absl::StrCat("worker ", worker_id, " is draining"));
  });
  apply_effects(deferred);
  return absl::OkStatus();
}

void Coordinator::ban_worker(const std::string& worker_id, std::function<void(absl::Status)> done) {
  post_to_writer([this, worker_id, done = std::move(done)] {
    absl::Status status;
    std::vector<std::string> names;
    {
      MutexLock lock(mutex_);
      if (scheduler_.find_worker(worker_id) == nullptr) status = no_such_worker(worker_id);
      names = scheduler_.shut_out_names(worker_id);
    }
    for (const std::string& name : names) {
      if (status.ok()) status = store_.ban_worker(name);
    }
    if (!status.ok()) return done(status);
    {
      DeferredCalls deferred;
      MutexLock lock(mutex_);
      scheduler_.ban(worker_id);
      scheduler_.offer_work(options_.clock());
      note(EventKind::worker_banned, worker_id, "");
      deferred.add([this, worker_id] {
        log(LogLevel::warn, absl::StrCat("worker ", worker_id, " is banned"));
      });
      apply_effects(deferred);
    }
    done(absl::OkStatus());
  });
}

void Coordinator::allow_worker(const std::string& worker_id,
                               std::function<void(absl::Status)> done) {
  post_to_writer([this, worker_id, done = std::move(done)] {
    std::vector<std::string> names;
    {
      MutexLock lock(mutex_);
      names = scheduler_.shut_out_names(worker_id);
    }
    absl::Status status;
    for (const std::string& name : names) {
      if (status.ok()) status = store_.allow_worker(name);
    }
    if (!status.ok()) return done(status);
    {
      DeferredCalls deferred;
      MutexLock lock(mutex_);
      if (!scheduler_.allow(worker_id, options_.clock())) {
        status = no_such_worker(worker_id);
      } else {
        note(EventKind::worker_allowed, worker_id, "");
      }
      apply_effects(deferred);
    }
    done(status);
  });
}

}  // namespace tessera::server
