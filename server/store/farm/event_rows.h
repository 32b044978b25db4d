#pragma once

#include <atomic>

#include "server/store/farm/event_store.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Events as rows of the journal.
class EventRows final : public EventStore {
 public:
  EventRows(Journal& journal, std::int64_t max_events)
      : journal_(journal), max_events_(max_events) {}
  /// Reads how many events there are.
  absl::Status open();

  absl::Status add(const std::vector<Event>& events) override;
  absl::Status note_lost(std::int64_t before) override;
  absl::StatusOr<std::vector<Event>> read(const EventQuery& query,
                                          std::size_t limit) const override;
  absl::StatusOr<std::vector<Event>> newest(std::size_t limit) const override;
  std::int64_t last_dropped() const override { return last_dropped_; }

 private:
  absl::Status drop_oldest(Database& rows, std::int64_t count);

  Journal& journal_;
  const std::int64_t max_events_;
  std::int64_t count_ = 0;                        // rows
  std::int64_t last_first_ = 0, last_batch_ = 0;  // first sequence and size of the last add()
  std::atomic<std::int64_t> last_dropped_ = 0;
};

}  // namespace tessera::server
