#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/store/farm/worker_store.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Roster, bans and joins as rows of the journal.
class WorkerRows final : public WorkerStore {
 public:
  /// `now_us` returns the wall-clock time in microseconds.
  WorkerRows(Journal& journal, std::function<std::int64_t()> now_us)
      : journal_(journal), now_us_(std::move(now_us)) {}

  absl::Status add_worker(const std::string& worker_id, const std::string& name) override;
  absl::Status remove_worker(const std::string& worker_id) override;
  absl::StatusOr<std::vector<std::string>> roster() const override;
  absl::Status ban_worker(const std::string& worker_id) override;
  absl::Status allow_worker(const std::string& worker_id) override;
  absl::StatusOr<std::vector<std::string>> banned_workers() const override;
  absl::Status record_join(const Join& join, std::int64_t max_joins) override;
  absl::Status remove_stale_joins(const std::vector<std::string>& valid,
                                  std::int64_t unseen_since_us) override;

 private:
  absl::StatusOr<std::vector<std::string>> read_ids(std::string_view sql) const;

  Journal& journal_;
  const std::function<std::int64_t()> now_us_;
};

}  // namespace tessera::server
