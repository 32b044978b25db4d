#include "server/telemetry/event_log.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace tessera::server {
namespace {

constexpr int kSequenceBits = 40;  // per process; see also the schema's step to events

/// The first event newer than a sequence.
auto newer_than(const std::deque<Event>& events, std::int64_t sequence) {
  return std::upper_bound(events.begin(), events.end(), sequence,
                          [](std::int64_t s, const Event& event) { return s < event.sequence; });
}

/// Whether an event of this kind changes the state or the settings of its job.
bool changes_job(EventKind kind) {
  return (kind >= EventKind::job_submitted && kind <= EventKind::job_removed) ||
         kind == EventKind::job_changed || kind == EventKind::job_paused_by_failures ||
         kind == EventKind::job_queued;
}

std::vector<std::string> changed_jobs(const std::vector<Event>& events) {
  std::vector<std::string> jobs;
  for (const Event& event : events) {
    if (changes_job(event.kind)) jobs.push_back(event.job_id);
  }
  return jobs;
}

}  // namespace

std::string cut_text(std::string text, std::size_t max_bytes) {
  if (text.size() <= max_bytes) return text;
  while (max_bytes > 0 && (static_cast<unsigned char>(text[max_bytes]) & 0xC0) == 0x80) --max_bytes;
  text.resize(max_bytes);
  return text;
}

EventLog::EventLog(std::int64_t boot_count, std::function<std::int64_t()> wall_us)
    : wall_us_(std::move(wall_us)),
      last_sequence_(boot_count << kSequenceBits),
      last_number_(last_sequence_) {}

void EventLog::load(std::vector<Event> events, std::int64_t last_dropped) {
  const MutexLock lock(mutex_);
  const bool has_all = events.size() < kMaxEvents;
  complete_after_ = has_all ? last_dropped : events.front().sequence - 1;
  if (!events.empty()) last_sequence_ = std::max(last_sequence_, events.back().sequence);
  last_number_ = last_sequence_;
  events_.assign(std::make_move_iterator(events.begin()), std::make_move_iterator(events.end()));
}

// Writing ----------------------------------------------------------------------------------------

Event EventLog::stamp(Event event) const {
  event.time_us = wall_us_();
  event.text = cut_text(std::move(event.text), kMaxTextBytes);
  return event;
}

void EventLog::add(Event event) {
  event = stamp(std::move(event));
  bool is_first = false;
  {
    const MutexLock lock(mutex_);
    is_first = pending_.empty();
    pending_.push_back(std::move(event));
    if (pending_.size() > kMaxPending) {  // nothing can be written
      has_lost_ = has_lost_ || pending_.front().kind != EventKind::log_line;
      pending_.pop_front();
    }
  }
  if (is_first && wake_) wake_();
}

bool EventLog::has_pending() const {
  const MutexLock lock(mutex_);
  return !pending_.empty();
}

EventLog::Pending EventLog::take_pending() {
  const MutexLock lock(mutex_);
  Pending taken{
      {std::make_move_iterator(pending_.begin()), std::make_move_iterator(pending_.end())},
      std::exchange(has_lost_, false)};
  pending_.clear();
  return taken;
}

void EventLog::put_back(Pending pending) {
  const MutexLock lock(mutex_);
  has_lost_ = has_lost_ || pending.has_lost;
  pending_.insert(pending_.begin(), std::make_move_iterator(pending.events.begin()),
                  std::make_move_iterator(pending.events.end()));
}

std::vector<Event> EventLog::number(std::vector<Event> events) {
  const MutexLock lock(mutex_);
  for (Event& event : events) event.sequence = ++last_number_;
  return events;
}

void EventLog::publish(std::vector<Event> events) {
  if (events.empty()) return;
  const std::vector<std::string> jobs = changed_jobs(events);
  keep(std::move(events));
  for (const auto& reader : take_readers(jobs)) reader->wake();
}

EventLog::Readers EventLog::take_readers(const std::vector<std::string>& jobs) {
  const MutexLock lock(mutex_);
  Readers readers;
  std::swap(readers, waiting_);
  for (const std::string& job_id : jobs) {
    const auto waiting = job_readers_.find(job_id);
    if (waiting == job_readers_.end()) continue;
    readers.merge(waiting->second);
    job_readers_.erase(waiting);
  }
  return readers;
}

void EventLog::keep(std::vector<Event> events) {
  const MutexLock lock(mutex_);
  for (Event& event : events) {
    last_sequence_ = event.sequence;
    if (event.kind == EventKind::log_line) {
      keep_line(std::move(event));
      continue;
    }
    events_.push_back(std::move(event));
    if (events_.size() <= kMaxEvents) continue;
    complete_after_ = events_.front().sequence;
    events_.pop_front();
  }
}

void EventLog::keep_line(Event line) {
  std::deque<Event>& lines = lines_[line.job_id];
  lines.push_back(std::move(line));
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

// Reading ----------------------------------------------------------------------------------------

bool EventLog::wake_after(std::int64_t seen, const std::shared_ptr<EventReader>& reader) const {
  const MutexLock lock(mutex_);
  if (last_sequence_ > seen) return false;
  waiting_.insert(reader);
  return true;
}

void EventLog::forget_reader(const std::shared_ptr<EventReader>& reader) const {
  const MutexLock lock(mutex_);
  waiting_.erase(reader);
}

bool EventLog::wake_after_change(std::int64_t seen, const std::string& job_id,
                                 const std::shared_ptr<EventReader>& reader) const {
  const MutexLock lock(mutex_);
  if (seen < complete_after_) return false;  // the change may no longer be in memory
  const auto newer = newer_than(events_, seen);
  const bool is_changed = std::any_of(newer, events_.end(), [&job_id](const Event& event) {
    return event.job_id == job_id && changes_job(event.kind);
  });
  if (!is_changed) job_readers_[job_id].insert(reader);
  return !is_changed;
}

void EventLog::forget_reader(const std::string& job_id,
                             const std::shared_ptr<EventReader>& reader) const {
  const MutexLock lock(mutex_);
  const auto waiting = job_readers_.find(job_id);
  if (waiting == job_readers_.end()) return;
  waiting->second.erase(reader);
  if (waiting->second.empty()) job_readers_.erase(waiting);
}

std::int64_t EventLog::newest() const {
  const MutexLock lock(mutex_);
  return last_sequence_;
}

std::int64_t EventLog::complete_after() const {
  const MutexLock lock(mutex_);
  return complete_after_;
}

std::vector<Event> EventLog::read(const EventQuery& query, std::size_t limit) const {
  std::vector<Event> found;
  std::int64_t last = 0;
  {
    const MutexLock lock(mutex_);
    last = last_sequence_;
    for (auto event = newer_than(events_, query.after);
         event != events_.end() && found.size() < limit; ++event) {
      if (!query.job_id.empty() && event->job_id != query.job_id) continue;
      if (is_visible_to(*event, query.owner)) found.push_back(*event);
    }
    if (found.size() == limit && limit > 0) last = found.back().sequence;
  }
  found = with_lines(std::move(found), query, last);
  if (found.size() > limit) found.resize(limit);
  return found;
}

std::vector<Event> EventLog::with_lines(std::vector<Event> events, const EventQuery& query,
                                        std::int64_t last) const {
  if (query.job_id.empty()) return events;
  const MutexLock lock(mutex_);
  const auto lines = lines_.find(query.job_id);
  if (lines == lines_.end()) return events;
  std::vector<Event> all;
  std::merge(events.begin(), events.end(), newer_than(lines->second, query.after),
             newer_than(lines->second, last), std::back_inserter(all),
             [](const Event& a, const Event& b) { return a.sequence < b.sequence; });
  return all;
}

}  // namespace tessera::server
