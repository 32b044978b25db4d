#pragma once

#include <algorithm>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "server/store/farm/event_store.h"
#include "server/store/farm/usage_store.h"

namespace tessera::server {

/// Events in memory.
class MemoryEvents final : public EventStore {
 public:
  void keep(std::size_t count) { max_events_ = count; }

  absl::Status add(const std::vector<Event>& events) override {
    const std::lock_guard lock(mutex_);
    events_.insert(events_.end(), events.begin(), events.end());
    for (; events_.size() > max_events_; events_.pop_front()) {
      last_dropped_ = events_.front().sequence;
    }
    return absl::OkStatus();
  }
  absl::Status note_lost(std::int64_t before) override {
    last_dropped_ = before - 1;
    return absl::OkStatus();
  }
  absl::StatusOr<std::vector<Event>> read(const EventQuery& query,
                                          std::size_t limit) const override {
    const std::lock_guard lock(mutex_);
    std::vector<Event> found;
    for (const Event& event : events_) {
      if (event.sequence <= query.after || found.size() == limit) continue;
      if (!query.job_id.empty() && event.job_id != query.job_id) continue;
      if (is_visible_to(event, query.owner)) found.push_back(event);
    }
    return found;
  }
  absl::StatusOr<std::vector<Event>> newest(std::size_t limit) const override {
    const std::lock_guard lock(mutex_);
    const std::size_t count = std::min(limit, events_.size());
    return std::vector<Event>(events_.end() - static_cast<std::ptrdiff_t>(count), events_.end());
  }
  std::int64_t last_dropped() const override { return last_dropped_; }

 private:
  mutable std::mutex mutex_;
  std::size_t max_events_ = 200'000;
  std::deque<Event> events_;
  std::int64_t last_dropped_ = 0;
};

/// Accounts in memory. Groups by job only.
class MemoryUsage final : public UsageStore {
 public:
  void add(std::int64_t hour, const UsageSum& use) { uses_.emplace_back(hour, use); }
  /// Takes back the charge of a unit of the job with this CPU time.
  void refund(const std::string& job_id, double cpu_seconds) {
    const auto found = std::find_if(uses_.begin(), uses_.end(), [&](const auto& use) {
      return use.second.job_id == job_id && use.second.cpu_seconds == cpu_seconds;
    });
    if (found != uses_.end()) uses_.erase(found);
  }

  absl::StatusOr<std::vector<UsageSum>> read(const UsageQuery& query,
                                             std::size_t /*limit*/) const override {
    std::vector<UsageSum> sums;
    for (const auto& entry : uses_) {
      const UsageSum& use = entry.second;  // Clang 14 lets lambdas capture no structured bindings
      if (!matches(query, entry.first, use)) continue;
      const auto same = std::find_if(sums.begin(), sums.end(),
                                     [&](const UsageSum& sum) { return sum.job_id == use.job_id; });
      if (same == sums.end()) {
        sums.push_back(use);
      } else {
        same->units += use.units;
        same->cpu_seconds += use.cpu_seconds;
      }
    }
    return sums;
  }
  absl::StatusOr<std::map<std::int64_t, Kept>> kept() const override { return kept_; }
  void set_kept(std::int64_t job, const Kept& kept) { kept_[job] = kept; }
  absl::StatusOr<double> cpu_seconds(const UsageQuery& query) const override {
    double sum = 0;
    for (const auto& [hour, use] : uses_) sum += matches(query, hour, use) ? use.cpu_seconds : 0;
    return sum;
  }

 private:
  static bool matches(const UsageQuery& query, std::int64_t hour, const UsageSum& use) {
    return hour >= query.first_hour && hour < query.end_hour &&
           (!query.owner || *query.owner == use.owner) &&
           (!query.project || *query.project == use.project);
  }

  std::vector<std::pair<std::int64_t, UsageSum>> uses_;  // by hour
  std::map<std::int64_t, Kept> kept_;
};

}  // namespace tessera::server
