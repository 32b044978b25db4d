#include "server/store/farm/event_rows.h"

#include <algorithm>

namespace tessera::server {
namespace {

Event read_event(const SqlRow& row) {
  return {row.integer(0), row.integer(1), static_cast<EventKind>(row.integer(2)),
          row.text(3),    row.text(4),    row.text(5),
          row.text(6)};
}

}  // namespace

absl::Status EventRows::open() {
  return journal_.read_as_writer([&](Database& rows) {
    absl::Status status = rows.each("SELECT COUNT(*) FROM events", {},
                                    [&](const SqlRow& row) { count_ = row.integer(0); });
    status.Update(rows.each("SELECT dropped_event FROM store", {},
                            [&](const SqlRow& row) { last_dropped_ = row.integer(0); }));
    return status;
  });
}

absl::Status EventRows::add(const std::vector<Event>& events) {
  if (events.empty()) return absl::OkStatus();
  // After a transaction that failed, its sequences are used again.
  if (events.front().sequence <= last_first_) count_ -= last_batch_;
  last_first_ = events.front().sequence;
  last_batch_ = static_cast<std::int64_t>(events.size());
  count_ += last_batch_;
  return journal_.write([&](Database& rows) {
    for (const Event& event : events) {
      absl::Status added = rows.run(
          "INSERT INTO events(sequence, time_us, kind, job, owner, worker, text) "
          "VALUES(?, ?, ?, ?, ?, ?, ?)",
          {event.sequence, event.time_us, static_cast<std::int64_t>(event.kind), event.job_id,
           event.owner, event.worker_id, event.text});
      if (!added.ok()) return added;
    }
    // Seldom, and then many.
    const std::int64_t excess = count_ - max_events_;
    if (excess < std::max<std::int64_t>(max_events_ / 20, 1)) return absl::OkStatus();
    return drop_oldest(rows, excess);
  });
}

absl::Status EventRows::drop_oldest(Database& rows, std::int64_t count) {
  std::int64_t last = 0;
  absl::Status status = rows.each("SELECT sequence FROM events ORDER BY sequence LIMIT 1 OFFSET ?",
                                  {count - 1}, [&](const SqlRow& row) { last = row.integer(0); });
  status.Update(rows.run("DELETE FROM events WHERE sequence<=?", {last}));
  status.Update(rows.run("UPDATE store SET dropped_event=MAX(dropped_event, ?)", {last}));
  if (!status.ok()) return status;
  count_ -= count;
  last_dropped_ = std::max<std::int64_t>(last_dropped_, last);
  return absl::OkStatus();
}

absl::Status EventRows::note_lost(std::int64_t before) {
  absl::Status status = journal_.write([&](Database& rows) {
    return rows.run("UPDATE store SET dropped_event=MAX(dropped_event, ?)", {before - 1});
  });
  if (status.ok()) last_dropped_ = std::max<std::int64_t>(last_dropped_, before - 1);
  return status;
}

absl::StatusOr<std::vector<Event>> EventRows::read(const EventQuery& query,
                                                   std::size_t limit) const {
  std::vector<Event> events;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT sequence, time_us, kind, job, owner, worker, text FROM events "
        "WHERE sequence>?1 AND (?2='' OR job=?2) AND (?3='' OR owner=?3 OR "
        "(owner='' AND job='' AND kind NOT IN (?4, ?5))) ORDER BY sequence LIMIT ?6",
        {query.after, query.job_id, query.owner,
         static_cast<std::int64_t>(EventKind::budget_warning),
         static_cast<std::int64_t>(EventKind::budget_used_up), static_cast<std::int64_t>(limit)},
        [&](const SqlRow& row) { events.push_back(read_event(row)); });
  });
  if (!status.ok()) return status;
  return events;
}

absl::StatusOr<std::vector<Event>> EventRows::newest(std::size_t limit) const {
  std::vector<Event> events;
  absl::Status status = journal_.read_as_writer([&](Database& rows) {
    return rows.each(
        "SELECT sequence, time_us, kind, job, owner, worker, text FROM events "
        "ORDER BY sequence DESC LIMIT ?",
        {static_cast<std::int64_t>(limit)},
        [&](const SqlRow& row) { events.push_back(read_event(row)); });
  });
  if (!status.ok()) return status;
  std::reverse(events.begin(), events.end());
  return events;
}

}  // namespace tessera::server
