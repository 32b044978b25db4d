#include "server/commit/commit_pipeline.h"

#include "absl/strings/str_cat.h"

namespace tessera::server {

bool CommitPipeline::run(bool wait) {
  Round round;
  {
    const MutexLock lock(mutex_);
    while (wait && !stopping_ && next_.is_empty() && !retry_) wakeup_.wait(mutex_);
    if (next_.is_empty() && !retry_) return false;
    std::swap(round, next_);
    if (retry_) round.changed.merge(unwritten_);
    retry_ = false;
  }
  write_jobs(round);
  write_roster(round);
  for (const auto& task : round.tasks) task();
  return true;
}

void CommitPipeline::stop() {
  const MutexLock lock(mutex_);
  stopping_ = true;
  wakeup_.notify_all();
}

bool CommitPipeline::is_stopping() const {
  const MutexLock lock(mutex_);
  return stopping_;
}

void CommitPipeline::post(std::function<void()> task) {
  const MutexLock lock(mutex_);
  next_.tasks.push_back(std::move(task));
  wakeup_.notify_all();
}

void CommitPipeline::answer_when_written(FarmChange& /*change*/, JobKey job, Answer answer) {
  const MutexLock lock(mutex_);
  next_.changed.insert(job);
  next_.answers.emplace(job, std::move(answer));
  wakeup_.notify_all();
}

void CommitPipeline::write_row(FarmChange& /*change*/, JobKey job) {
  const MutexLock lock(mutex_);
  next_.changed.insert(job);
  wakeup_.notify_all();
}

void CommitPipeline::write_running(FarmChange& change) {
  std::set<JobKey> running;
  for (const auto& [key, job] : change.scheduler().jobs()) {
    if (job.running_since) running.insert(key);
  }
  const MutexLock lock(mutex_);
  next_.changed.merge(running);
  retry_ = true;
  wakeup_.notify_all();
}

void CommitPipeline::carry_out(FarmChange& /*change*/, const Effects& effects) {
  if (effects.changed.empty() && effects.roster.empty()) return;
  const MutexLock lock(mutex_);
  next_.changed.insert(effects.changed.begin(), effects.changed.end());
  next_.roster.insert(next_.roster.end(), effects.roster.begin(), effects.roster.end());
  wakeup_.notify_all();
}

void CommitPipeline::write_jobs(const Round& round) {
  std::vector<std::pair<JobKey, JobRecord>> records;
  {
    const FarmView view(farm_);
    for (const JobKey key : round.changed) {
      const auto job = view.scheduler().jobs().find(key);
      if (job != view.scheduler().jobs().end()) records.emplace_back(key, view.record(job->second));
    }
  }
  std::map<JobKey, absl::Status> failed;
  for (const auto& [key, record] : records) {
    absl::Status status = write_job(record);
    if (status.ok()) continue;
    farm_.metrics().errors.journal.Increment();
    farm_.log(LogLevel::error, absl::StrCat("job ", record.id, ": ", status.ToString()));
    unwritten_.insert(key);
    failed[key] = std::move(status);
  }
  for (const auto& [key, answer] : round.answers) {
    const auto failure = failed.find(key);
    answer(failure == failed.end() ? absl::OkStatus() : failure->second);
  }
}

absl::Status CommitPipeline::write_job(const JobRecord& record) {
  if (record.state == static_cast<std::int32_t>(JobState::done)) {
    // Blocks and units first: a job that is DONE in the journal has none.
    absl::Status closed = store_.close_job(record.id);
    if (!closed.ok()) return closed;
  }
  return store_.update_job(record);
}

void CommitPipeline::write_roster(const Round& round) {
  for (const auto& [worker_id, joined] : round.roster) {
    const absl::Status status =
        joined ? store_.add_worker(worker_id, worker_id) : store_.remove_worker(worker_id);
    if (!status.ok()) {
      farm_.log(LogLevel::error, absl::StrCat("worker ", worker_id, ": ", status.ToString()));
    }
  }
}

}  // namespace tessera::server
