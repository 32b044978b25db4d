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
  post_rows(round);
  while (!round.tasks.empty()) {
    if (round.tasks.front().write) {
      write_together(round.tasks);
    } else {
      round.tasks.front().apart();
      round.tasks.pop_front();
    }
  }
  return true;
}

/// Runs the tasks up to the next one that runs apart, as one transaction.
void CommitPipeline::write_together(std::deque<Task>& tasks) {
  std::vector<std::pair<Answer, absl::Status>> outcomes;
  const auto each = [&](const std::function<absl::Status(const Task&)>& outcome) {
    for (; !tasks.empty() && tasks.front().write; tasks.pop_front()) {
      absl::Status status = outcome(tasks.front());
      outcomes.emplace_back(std::move(tasks.front().done), std::move(status));
    }
  };
  absl::Status together =
      store_.write_together([&] { each([](const Task& task) { return task.write(); }); });
  each([&](const Task&) -> absl::Status { return together; });  // those that were not tried
  for (const auto& [done, status] : outcomes) done(status.ok() ? together : status);
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
  next_.tasks.push_back({{}, {}, std::move(task)});
  wakeup_.notify_all();
}

void CommitPipeline::post_write(std::function<absl::Status()> write, Answer done) {
  const MutexLock lock(mutex_);
  next_.tasks.push_back({std::move(write), std::move(done), {}});
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

/// Puts the round's rows before its tasks.
void CommitPipeline::post_rows(Round& round) {
  std::deque<Task> rows;
  {
    const FarmView view(farm_);
    for (const JobKey key : round.changed) {
      std::vector<Answer> answers;
      const auto [first, last] = round.answers.equal_range(key);
      for (auto answer = first; answer != last; ++answer) answers.push_back(answer->second);
      const auto job = view.scheduler().jobs().find(key);
      const bool is_removed = job == view.scheduler().jobs().end();  // it has no row
      rows.push_back(row_task(key,
                              is_removed ? std::nullopt : std::optional(view.record(job->second)),
                              std::move(answers)));
    }
  }
  for (const auto& [worker_id, joined] : round.roster) {
    rows.push_back(roster_task(worker_id, joined));
  }
  for (Task& task : round.tasks) rows.push_back(std::move(task));
  round.tasks.swap(rows);
}

CommitPipeline::Task CommitPipeline::row_task(JobKey key, std::optional<JobRecord> record,
                                              std::vector<Answer> answers) {
  const std::string id = record ? record->id : "";
  const auto write = [this, row = std::move(record)] {
    return row ? write_job(*row) : absl::OkStatus();
  };
  const auto done = [this, key, id, called = std::move(answers)](const absl::Status& status) {
    if (!status.ok()) {
      farm_.metrics().errors.journal.Increment();
      farm_.log(LogLevel::error, absl::StrCat("job ", id, ": ", status.ToString()));
      unwritten_.insert(key);
    }
    for (const Answer& answer : called) answer(status);
  };
  return {write, done, {}};
}

absl::Status CommitPipeline::write_job(const JobRecord& record) {
  if (record.state == static_cast<std::int32_t>(JobState::done)) {
    // Blocks and units first: a job that is DONE in the journal has none.
    absl::Status closed = store_.close_job(record.id);
    if (!closed.ok()) return closed;
  }
  return store_.update_job(record);
}

CommitPipeline::Task CommitPipeline::roster_task(const std::string& worker_id, bool joined) {
  const auto write = [this, worker_id, joined] {
    return joined ? store_.add_worker(worker_id, worker_id) : store_.remove_worker(worker_id);
  };
  const auto done = [this, worker_id](const absl::Status& status) {
    if (status.ok()) return;
    farm_.log(LogLevel::error, absl::StrCat("worker ", worker_id, ": ", status.ToString()));
  };
  return {write, done, {}};
}

}  // namespace tessera::server
