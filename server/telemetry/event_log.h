#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "server/store/farm/event_store.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Returns the first `max_bytes` bytes of UTF-8 text, without a partial character at the end.
std::string cut_text(std::string text, std::size_t max_bytes);

/// A reader of the event log that waits for news.
class EventReader {
 public:
  virtual ~EventReader() = default;
  /// Called once, on any thread, when there are news. Must not wait, and not read the log.
  virtual void wake() = 0;
};

/// The newest events and log lines, in memory. An event becomes visible, and gets its sequence,
/// once it is durable (CommitPipeline), so that no reader sees one that a crash undoes.
///
/// Bounded: the newest kMaxEvents events, and separately, so that log lines displace no events, the
/// newest kMaxLines lines of workers' logs, kMaxLinesOfJob per job, kMaxTextBytes each. The store
/// has older events, but no lines. Thread-safe.
class EventLog {
 public:
  static constexpr std::size_t kMaxEvents = 10'000;
  static constexpr std::size_t kMaxLines = 50'000, kMaxLinesOfJob = 2'000;
  static constexpr std::size_t kMaxTextBytes = 1024;
  static constexpr std::size_t kMaxPending = 20'000;

  /// Sequences increase across restarts if `boot_count` does. `wall_us`: µs since 1970.
  EventLog(std::int64_t boot_count, std::function<std::int64_t()> wall_us);

  /// Called, on any thread, when there is something to write. Before any other thread exists.
  void on_pending(std::function<void()> wake) { wake_ = std::move(wake); }
  /// Fills the log with the newest events of the store. `last_dropped`: EventStore::last_dropped().
  void load(std::vector<Event> events, std::int64_t last_dropped);

  /// Adds an event or a line, to be written soon.
  void add(Event event);
  bool has_pending() const;

  // The writer thread.
  /// Returns what was added, without sequences.
  struct Pending {
    std::vector<Event> events;
    bool has_lost = false;  // events before these, of which there were too many
  };
  Pending take_pending();
  /// Puts the result of take_pending() back in front, after its write failed.
  void put_back(Pending pending);
  /// Returns the event with its time.
  Event stamp(Event event) const;
  /// Numbers events with the next sequences. Those of events that are never published are lost.
  std::vector<Event> number(std::vector<Event> events);
  /// Makes numbered events visible, which are durable or lines. In the order of their numbers; on
  /// any thread.
  void publish(std::vector<Event> events);

  /// Returns the oldest `limit` events that match, in order: with a job also its lines.
  std::vector<Event> read(const EventQuery& query, std::size_t limit) const;
  /// Merges the lines of the query's job up to a sequence into `events`, which are in order.
  std::vector<Event> with_lines(std::vector<Event> events, const EventQuery& query,
                                std::int64_t last) const;
  /// Wakes `reader` when something newer than the sequence `seen` is published. Returns false if it
  /// is already. A reader waits once; forget_reader() ends it.
  bool wake_after(std::int64_t seen, const std::shared_ptr<EventReader>& reader) const;
  void forget_reader(const std::shared_ptr<EventReader>& reader) const;
  /// The same for changes of a job's state or settings only.
  bool wake_after_change(std::int64_t seen, const std::string& job_id,
                         const std::shared_ptr<EventReader>& reader) const;
  void forget_reader(const std::string& job_id, const std::shared_ptr<EventReader>& reader) const;
  /// Sequence of the newest event, even if it is no longer kept.
  std::int64_t newest() const;
  /// Sequence after which all events are in memory.
  std::int64_t complete_after() const;

 private:
  using Readers = std::set<std::shared_ptr<EventReader>>;

  /// Ends and returns the waits for any event, and for changes of these jobs.
  Readers take_readers(const std::vector<std::string>& jobs) ABSL_LOCKS_EXCLUDED(mutex_);
  void keep(std::vector<Event> events) ABSL_LOCKS_EXCLUDED(mutex_);
  void keep_line(Event line) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::function<std::int64_t()> wall_us_;
  std::function<void()> wake_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::int64_t last_sequence_ ABSL_GUARDED_BY(mutex_);  // of what is visible
  std::int64_t last_number_ ABSL_GUARDED_BY(mutex_);
  std::int64_t complete_after_ ABSL_GUARDED_BY(mutex_) = 0;
  std::deque<Event> pending_ ABSL_GUARDED_BY(mutex_);
  bool has_lost_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<Event> events_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, std::deque<Event>> lines_ ABSL_GUARDED_BY(mutex_);  // by job
  std::size_t line_count_ ABSL_GUARDED_BY(mutex_) = 0;
  mutable Readers waiting_ ABSL_GUARDED_BY(mutex_);
  mutable std::map<std::string, Readers> job_readers_ ABSL_GUARDED_BY(mutex_);  // by job
};

}  // namespace tessera::server
