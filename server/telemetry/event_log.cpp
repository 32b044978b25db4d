#include "server/telemetry/event_log.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace tessera::server {
namespace {

constexpr int kSequenceBits = 40;  // per process

/// The first event newer than a sequence.
auto newer_than(const std::deque<Event>& events, std::int64_t sequence) {
  return std::upper_bound(events.begin(), events.end(), sequence,
                          [](std::int64_t s, const Event& event) { return s < event.sequence; });
}

}  // namespace

std::string cut_text(std::string text, std::size_t max_bytes) {
  if (text.size() <= max_bytes) return text;
  while (max_bytes > 0 && (static_cast<unsigned char>(text[max_bytes]) & 0xC0) == 0x80) --max_bytes;
  text.resize(max_bytes);
  return text;
}

EventLog::EventLog(std::int64_t boot_count, std::function<std::int64_t()> wall_us)
    : wall_us_(std::move(wall_us)), last_sequence_(boot_count << kSequenceBits) {}

void EventLog::add(Event event) {
  const std::int64_t now_us = wall_us_();
  const std::lock_guard lock(mutex_);
  event.sequence = ++last_sequence_;
  event.time_us = now_us;
  event.text = cut_text(std::move(event.text), kMaxTextBytes);
  if (event.kind != EventKind::log_line) {
    events_.push_back(std::move(event));
    if (events_.size() > kMaxEvents) events_.pop_front();
    return;
  }
  std::deque<Event>& lines = lines_[event.job_id];
  lines.push_back(std::move(event));
  ++line_count_;
  if (lines.size() <= kMaxLinesOfJob && line_count_ <= kMaxLines) return;
  // The job's own oldest line, or the oldest of all.
  auto victim = lines_.find(lines.front().job_id);
  if (lines.size() <= kMaxLinesOfJob) {
    victim = std::min_element(lines_.begin(), lines_.end(), [](const auto& a, const auto& b) {
      return a.second.front().sequence < b.second.front().sequence;
    });
  }
  victim->second.pop_front();
  --line_count_;
  if (victim->second.empty()) lines_.erase(victim);
}

std::int64_t EventLog::newest() const {
  const std::lock_guard lock(mutex_);
  return last_sequence_;
}

std::vector<Event> EventLog::read(const Query& query, std::size_t limit) const {
  const std::lock_guard lock(mutex_);
  std::vector<Event> found;
  for (auto event = newer_than(events_, query.after);
       event != events_.end() && found.size() < limit; ++event) {
    if (!query.job_id.empty() && event->job_id != query.job_id) continue;
    if (!query.owner.empty() && !event->job_id.empty() && event->owner != query.owner) continue;
    found.push_back(*event);
  }
  const auto lines = lines_.find(query.job_id);
  if (query.job_id.empty() || lines == lines_.end()) return found;
  // Both lists are in order: merge the oldest `limit` events.
  const auto first = newer_than(lines->second, query.after);
  const auto count = std::min<std::ptrdiff_t>(std::distance(first, lines->second.end()),
                                              static_cast<std::ptrdiff_t>(limit));
  std::vector<Event> all;
  all.reserve(found.size() + static_cast<std::size_t>(count));
  std::merge(found.begin(), found.end(), first, first + count, std::back_inserter(all),
             [](const Event& a, const Event& b) { return a.sequence < b.sequence; });
  if (all.size() > limit) all.resize(limit);
  return all;
}

}  // namespace tessera::server
