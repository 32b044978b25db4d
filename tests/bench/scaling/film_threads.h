#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <map>
#include <queue>
#include <tuple>
#include <vector>

#include "server/schedule/plan/job_spec.h"

namespace tessera::bench {

/// The film threads of the server and their queue (server/sync/strand_queue.h), simulated: tasks of
/// a frame run in order and never at the same time, those of different frames may, oldest first.
/// One thread is left for merges: at most threads − 1 images are written at the same time.
class FilmThreads {
 public:
  using Time = server::Time;
  using Duration = server::Duration;

  /// Requires threads >= 1.
  explicit FilmThreads(int threads) : threads_(threads) {}

  /// Posts a task that takes `length`. Requires that `now` does not decrease.
  void post(Time now, std::int32_t frame, Duration length, bool is_image) {
    run_until(now);
    Strand& strand = strands_[frame];
    strand.waiting.push_back({++number_, length, is_image});
    if (!strand.is_running && strand.waiting.size() == 1) make_ready(frame, strand);
    start(now);
  }
  /// Runs all tasks. Returns when the last one has ended.
  Time finish() {
    run_until(Time::max());
    return last_end_;
  }
  /// Time that all threads together have spent on the tasks that have started.
  Duration busy() const { return busy_; }

 private:
  struct Task {
    std::int64_t number = 0;
    Duration length{};
    bool is_image = false;
  };
  struct Strand {
    std::deque<Task> waiting;
    bool is_running = false;
  };
  struct Running {
    Time end;
    std::int64_t number = 0;
    std::int32_t frame = 0;
    bool is_image = false;
    bool operator<(const Running& other) const {
      return std::tie(other.end, other.number) < std::tie(end, number);
    }
  };
  using Ready = std::map<std::int64_t, std::int32_t>;  // frame by number of its first task

  void make_ready(std::int32_t frame, const Strand& strand) {
    const Task& first = strand.waiting.front();
    (first.is_image ? images_ : merges_)[first.number] = frame;
  }
  void run_until(Time now) {
    while (!running_.empty() && running_.top().end <= now) {
      const Running ended = running_.top();
      running_.pop();
      if (ended.is_image) --image_count_;
      Strand& strand = strands_[ended.frame];
      strand.is_running = false;
      if (!strand.waiting.empty()) make_ready(ended.frame, strand);
      start(ended.end);
    }
  }
  /// Starts tasks while threads are free.
  void start(Time now) {
    while (running_.size() < static_cast<std::size_t>(threads_)) {
      const bool may_write = !images_.empty() && image_count_ < std::max(1, threads_ - 1);
      const bool is_image = may_write && (merges_.empty() || *images_.begin() < *merges_.begin());
      Ready& ready = is_image ? images_ : merges_;
      if (ready.empty()) return;
      const std::int32_t frame = ready.begin()->second;
      ready.erase(ready.begin());
      Strand& strand = strands_[frame];
      const Task task = strand.waiting.front();
      strand.waiting.pop_front();
      strand.is_running = true;
      if (is_image) ++image_count_;
      busy_ += task.length;
      last_end_ = std::max(last_end_, now + task.length);
      running_.push({now + task.length, task.number, frame, is_image});
    }
  }

  const int threads_;
  std::map<std::int32_t, Strand> strands_;
  Ready merges_, images_;
  std::priority_queue<Running> running_;
  int image_count_ = 0;
  std::int64_t number_ = 0;
  Duration busy_{};
  Time last_end_{};
};

}  // namespace tessera::bench
