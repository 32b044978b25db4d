#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Writes rows and runs tasks that write, in order, on one thread, with one transaction per round.
/// No other thread writes to the journal or to segment files. A second thread gives the outcomes
/// as answers, in the same order, while the first one writes the next round.
///
/// Events are written with the rows of the changes that they report, and become visible when the
/// transaction is durable.
class CommitPipeline final : public EffectHandler {
 public:
  /// Gets the outcome of a write. Called without locks, one answer at a time; must not block.
  using Answer = std::function<void(absl::Status)>;

  CommitPipeline(FarmState& farm, Store& store);

  /// Body of the writer thread: writes what is pending; if `wait`, first waits until there is
  /// something. Returns whether it did anything.
  bool write(bool wait) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Body of the answering thread: gives the answers of what has been written; if `wait`, first
  /// waits until there are some. Returns whether it gave any.
  bool answer(bool wait) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Runs `act` once the events of all answers given so far are visible: at once, or, during a
  /// round of answers, after them on their thread. It must not block.
  void after_answers(std::function<void()> act) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Ends waiting rounds. Further rounds without waiting still write what is queued.
  void stop() ABSL_LOCKS_EXCLUDED(mutex_);
  bool is_stopping() const ABSL_LOCKS_EXCLUDED(mutex_);
  /// Number of writes and answers that wait.
  std::size_t waiting_count() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(mutex_);
    return next_.changed.size() + next_.roster.size() + next_.answers.size() + next_.tasks.size() +
           outcomes_.size();
  }

  /// Runs `write`, which calls writing functions of the store, within the transaction of a round,
  /// then `done` with the outcome: `write`'s own error, else the transaction's. In order with what
  /// was posted before; but the answers of one round may come after the writes of the next. If the
  /// transaction cannot begin, only `done` runs.
  void post_write(std::function<absl::Status()> write, Answer done) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Runs a task on the writer thread between transactions, in order with what was posted before:
  /// all answers to that have been given, and no others are given meanwhile.
  void post(std::function<void()> task) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Records an event in the open transaction. Call within `write` of post_write() or
  /// write_apart(), after the change that the event reports has been written.
  void tell(Event event) { told_.push_back(farm_.events().stamp(std::move(event))); }
  /// Runs `write`, which may call tell(), as one transaction. Call within a task of post().
  ///
  /// Errors: those of `write`, the other parts of which are durable; those of the transaction.
  absl::Status write_apart(const std::function<absl::Status()>& write);
  /// Runs `write` and records an event in one transaction. Call within a task of post(). Errors:
  /// those of `write`; then there is no event.
  absl::Status write_and_tell(const std::function<absl::Status()>& write, Event event);
  /// Writes the job's row as it is at the end of this change, then calls `answer` with the outcome.
  void answer_when_written(FarmChange& change, JobKey job, Answer answer)
      ABSL_LOCKS_EXCLUDED(mutex_);
  /// Writes the job's row soon.
  void write_row(FarmChange& change, JobKey job) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Writes the running time of jobs, and retries rows that could not be written.
  void write_running(FarmChange& change) ABSL_LOCKS_EXCLUDED(mutex_);
  void carry_out(FarmChange& change, const Effects& effects) override ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Task {
    std::function<absl::Status()> write;  // empty: `apart`
    Answer done;
    std::function<void()> apart;
  };
  /// The status of a write, and the answer that receives it.
  struct Outcome {
    Answer done;
    absl::Status status;
  };
  /// The writes of one round of the thread.
  struct Round {
    std::set<JobKey> changed;
    std::vector<std::pair<std::string, bool>> roster;  // worker ID; true: joined, false: gone
    std::multimap<JobKey, Answer> answers;
    std::deque<Task> tasks;
    EventLog::Pending events;
    bool is_empty() const {
      return changed.empty() && roster.empty() && answers.empty() && tasks.empty();
    }
  };

  bool has_work() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Round take_round() ABSL_LOCKS_EXCLUDED(mutex_);
  void post_rows(const FarmView& farm, Round& round);
  Task row_task(JobKey key, std::optional<JobRecord> record, std::vector<Answer> answers);
  Task roster_task(const std::string& worker_id, bool joined);
  void write_together(std::deque<Task>& tasks, EventLog::Pending events);
  absl::Status record(const EventLog::Pending& events);
  std::vector<Event> finish_recording(const absl::Status& together, const absl::Status& recorded,
                                      EventLog::Pending events);
  absl::Status write_job(const JobRecord& record);
  Outcome publishing(std::vector<Event> events);
  void post_answers(std::deque<Outcome> outcomes) ABSL_LOCKS_EXCLUDED(mutex_);
  bool give_answers() ABSL_LOCKS_EXCLUDED(answering_, mutex_);

  FarmState& farm_;
  Store& store_;
  // Writer thread only.
  std::vector<Event> told_;      // with tell(), in the open transaction
  std::vector<Event> numbered_;  // all events of the open transaction
  bool has_unwritten_events_ = false;

  /// Held while answers are given, so that they keep their order.
  Mutex answering_ ABSL_ACQUIRED_AFTER(lock_order::kAnswers)
      ABSL_ACQUIRED_BEFORE(lock_order::kAdmission){lock_order::kAnswers};
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kPipeline)
      ABSL_ACQUIRED_BEFORE(lock_order::kJournal){lock_order::kPipeline};
  ConditionVariable wakeup_, answer_wakeup_;
  Round next_ ABSL_GUARDED_BY(mutex_);
  std::deque<Outcome> outcomes_ ABSL_GUARDED_BY(mutex_);  // not answered yet
  bool is_answering_ ABSL_GUARDED_BY(mutex_) = false;
  std::set<JobKey> unwritten_ ABSL_GUARDED_BY(mutex_);  // rows that could not be written
  bool retry_ ABSL_GUARDED_BY(mutex_) = false;          // the unwritten rows
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace tessera::server
