#include "server/commit/commit_pipeline.h"

#include <algorithm>
#include <iterator>

#include "absl/strings/str_cat.h"

namespace tessera::server {

CommitPipeline::CommitPipeline(FarmState& farm, Store& store) : farm_(farm), store_(store) {
  farm_.events().on_pending([this] {
    const MutexLock lock(mutex_);
    wakeup_.notify_all();
  });
}

bool CommitPipeline::write(bool wait) {
  {
    const MutexLock lock(mutex_);
    while (wait && !stopping_ && !has_work()) wakeup_.wait(mutex_);
    if (!has_work()) return false;
  }
  Round round = take_round();
  const bool has_events = !round.events.events.empty() || round.events.has_lost;
  if (has_events || (!round.tasks.empty() && round.tasks.front().write)) {
    write_together(round.tasks, std::move(round.events));
  }
  while (!round.tasks.empty()) {
    if (round.tasks.front().write) {
      write_together(round.tasks, {});
    } else {
      give_answers();  // the task may rely on them
      round.tasks.front().apart();
      round.tasks.pop_front();
    }
  }
  return true;
}

/// Events that could not be written wait for another write or the next try of unwritten rows.
bool CommitPipeline::has_work() const {
  return !next_.is_empty() || retry_ || (farm_.events().has_pending() && !has_unwritten_events_);
}

/// Takes what is to be written, with the farm locked, so that a row and the events about it are
/// taken together.
CommitPipeline::Round CommitPipeline::take_round() {
  Round round;
  const FarmView view(farm_);
  {
    const MutexLock lock(mutex_);
    std::swap(round, next_);
    if (retry_) round.changed.merge(unwritten_);
    retry_ = false;
  }
  post_rows(view, round);
  round.events = farm_.events().take_pending();
  return round;
}

/// Runs the tasks up to the next one that runs apart, as one transaction.
void CommitPipeline::write_together(std::deque<Task>& tasks, EventLog::Pending events) {
  std::vector<Task> group;
  for (; !tasks.empty() && tasks.front().write; tasks.pop_front()) {
    group.push_back(std::move(tasks.front()));
  }
  const bool has_only_lines =
      group.empty() && !events.has_lost &&
      std::all_of(events.events.begin(), events.events.end(),
                  [](const Event& event) { return event.kind == EventKind::log_line; });
  if (has_only_lines) {
    std::deque<Outcome> outcomes;
    outcomes.push_back(publishing(farm_.events().number(std::move(events.events))));
    return post_answers(std::move(outcomes));
  }
  std::vector<absl::Status> outcomes;
  absl::Status recorded;
  const absl::Status together = store_.write_together([&] {
    outcomes.clear();  // on a full disk the store may try twice
    told_.clear();
    for (const Task& task : group) outcomes.push_back(task.write());
    recorded = record(events);
  });
  outcomes.resize(group.size(), together);  // if none was tried
  std::deque<Outcome> answers;
  for (std::size_t i = 0; i < group.size(); ++i) {
    answers.push_back({std::move(group[i].done), outcomes[i].ok() ? together : outcomes[i]});
  }
  answers.push_back(publishing(finish_recording(together, recorded, std::move(events))));
  post_answers(std::move(answers));
}

/// Makes events visible after the answers before it, which change the state that they tell of.
CommitPipeline::Outcome CommitPipeline::publishing(std::vector<Event> events) {
  auto publish = [this, told = std::move(events)](const absl::Status& /*status*/) mutable {
    farm_.events().publish(std::move(told));
  };
  return {std::move(publish), {}};
}

/// Hands outcomes to the answering thread. If that still has those of the round before, the writer
/// helps it, so that at most one round waits for its answers while another is written.
void CommitPipeline::post_answers(std::deque<Outcome> outcomes) {
  {
    const MutexLock lock(mutex_);
    if (outcomes_.empty()) {
      outcomes_ = std::move(outcomes);
      return answer_wakeup_.notify_all();
    }
  }
  give_answers();
  post_answers(std::move(outcomes));
}

bool CommitPipeline::answer(bool wait) {
  {
    const MutexLock lock(mutex_);
    while (wait && !stopping_ && outcomes_.empty()) answer_wakeup_.wait(mutex_);
  }
  return give_answers();
}

/// Gives all answers that are due, after those that another thread is giving.
bool CommitPipeline::give_answers() {
  const MutexLock in_order(answering_);
  std::deque<Outcome> outcomes;
  {
    const MutexLock lock(mutex_);
    std::swap(outcomes, outcomes_);
    is_answering_ = true;
  }
  for (const Outcome& outcome : outcomes) outcome.done(outcome.status);
  const MutexLock lock(mutex_);
  is_answering_ = false;
  return !outcomes.empty();
}

void CommitPipeline::after_answers(std::function<void()> act) {
  {
    const MutexLock lock(mutex_);
    if (is_answering_ || !outcomes_.empty()) {
      outcomes_.push_back({[act = std::move(act)](const absl::Status& /*status*/) { act(); }, {}});
      return answer_wakeup_.notify_all();
    }
  }
  act();
}

/// Writes the events, and those of tell(), as a part of the open transaction.
absl::Status CommitPipeline::record(const EventLog::Pending& events) {
  numbered_ = events.events;
  numbered_.insert(numbered_.end(), told_.begin(), told_.end());
  numbered_ = farm_.events().number(std::move(numbered_));
  std::vector<Event> rows;
  std::copy_if(numbered_.begin(), numbered_.end(), std::back_inserter(rows),
               [](const Event& event) { return event.kind != EventKind::log_line; });
  if (rows.empty()) return absl::OkStatus();
  absl::Status status;
  if (events.has_lost) status = store_.events().note_lost(rows.front().sequence);
  return status.ok() ? store_.events().add(rows) : status;
}

/// Returns the events that a transaction with this outcome has made durable; if it has not, keeps
/// them for the next one.
std::vector<Event> CommitPipeline::finish_recording(const absl::Status& together,
                                                    const absl::Status& recorded,
                                                    EventLog::Pending events) {
  const absl::Status& status = together.ok() ? recorded : together;
  has_unwritten_events_ = !status.ok();
  if (status.ok()) return std::exchange(numbered_, {});
  // The changes are durable without their events, so these are kept as well.
  if (together.ok()) events.events.insert(events.events.end(), told_.begin(), told_.end());
  farm_.metrics().errors.journal.Increment();
  farm_.log(LogLevel::error, absl::StrCat("events: ", status.ToString()));
  farm_.events().put_back(std::move(events));
  return {};
}

absl::Status CommitPipeline::write_and_tell(const std::function<absl::Status()>& write,
                                            Event event) {
  return write_apart([&] {
    absl::Status written = write();
    if (written.ok()) tell(event);
    return written;
  });
}

absl::Status CommitPipeline::write_apart(const std::function<absl::Status()>& write) {
  EventLog::Pending events = farm_.events().take_pending();  // they happened before
  absl::Status written, recorded;
  const absl::Status together = store_.write_together([&] {
    told_.clear();
    written = write();
    recorded = record(events);
  });
  farm_.events().publish(finish_recording(together, recorded, std::move(events)));
  return together.ok() ? written : together;
}

void CommitPipeline::stop() {
  const MutexLock lock(mutex_);
  stopping_ = true;
  wakeup_.notify_all();
  answer_wakeup_.notify_all();
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
  const std::set<JobKey>& running = change.scheduler().jobs().of_state(JobState::running);
  const MutexLock lock(mutex_);
  next_.changed.insert(running.begin(), running.end());
  retry_ = true;
  wakeup_.notify_all();
}

void CommitPipeline::carry_out(FarmChange& /*change*/, const Effects& effects) {
  if (effects.changed.empty() && effects.revised.empty() && effects.roster.empty()) return;
  const MutexLock lock(mutex_);
  next_.changed.insert(effects.changed.begin(), effects.changed.end());
  next_.changed.insert(effects.revised.begin(), effects.revised.end());
  next_.roster.insert(next_.roster.end(), effects.roster.begin(), effects.roster.end());
  wakeup_.notify_all();
}

/// Puts the round's rows before its tasks.
void CommitPipeline::post_rows(const FarmView& farm, Round& round) {
  std::deque<Task> rows;
  for (const JobKey key : round.changed) {
    std::vector<Answer> answers;
    const auto [first, last] = round.answers.equal_range(key);
    for (auto answer = first; answer != last; ++answer) answers.push_back(answer->second);
    const Job* const job = farm.scheduler().jobs().find(key);  // null: removed, it has no row
    const bool has_row = job != nullptr && !job->spec->is_unreadable;
    rows.push_back(row_task(key, has_row ? std::optional(farm.record(*job)) : std::nullopt,
                            std::move(answers)));
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
      const MutexLock lock(mutex_);
      unwritten_.insert(key);
    }
    for (const Answer& answer : called) answer(status);
  };
  return {write, done, {}};
}

absl::Status CommitPipeline::write_job(const JobRecord& record) {
  if (record.state == static_cast<std::int32_t>(JobState::done)) {
    // Blocks and units first: a job that is DONE in the journal has none.
    absl::Status closed = store_.units().close_job(record.id);
    if (!closed.ok()) return closed;
  }
  return store_.jobs().update(record);
}

CommitPipeline::Task CommitPipeline::roster_task(const std::string& worker_id, bool joined) {
  const auto write = [this, worker_id, joined] {
    return joined ? store_.workers().add_worker(worker_id, worker_id)
                  : store_.workers().remove_worker(worker_id);
  };
  const auto done = [this, worker_id](const absl::Status& status) {
    if (status.ok()) return;
    farm_.log(LogLevel::error, absl::StrCat("worker ", worker_id, ": ", status.ToString()));
  };
  return {write, done, {}};
}

}  // namespace tessera::server
