#pragma once

#include <optional>
#include <string>
#include <vector>

#include "server/store/jobs/frame_rows.h"
#include "server/store/jobs/job_store.h"
#include "server/store/jobs/unit_rows.h"
#include "server/store/sqlite/disk_reserve.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Jobs as rows of the journal.
class JobRows final : public JobStore {
 public:
  JobRows(Journal& journal, DiskReserve& reserve, UnitRows& units, FrameRows& frames,
          std::int64_t max_removed)
      : journal_(journal),
        reserve_(reserve),
        units_(units),
        frames_(frames),
        max_removed_(max_removed) {}
  /// Reads how many removed jobs have rows.
  absl::Status count_removed();

  absl::Status add(JobRecord& job) override;
  absl::Status update(const JobRecord& job) override;
  absl::Status rewrite(const JobRecord& job, const std::vector<contract::Unit>& dropped) override;
  absl::Status remove(const std::string& job_id) override;
  absl::StatusOr<std::vector<JobRecord>> list() const override;
  absl::StatusOr<std::optional<std::int32_t>> removed_state(
      const std::string& job_id) const override;

 private:
  static absl::Status update_row(Database& rows, const JobRecord& job);
  absl::Status drop_old_rows();

  Journal& journal_;
  DiskReserve& reserve_;
  UnitRows& units_;
  FrameRows& frames_;
  const std::int64_t max_removed_;
  std::int64_t removed_count_ = 0;  // rows of removed jobs
};

}  // namespace tessera::server
