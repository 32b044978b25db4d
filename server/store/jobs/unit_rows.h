#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "server/store/files/durable_files.h"
#include "server/store/files/segments.h"
#include "server/store/jobs/job_keys.h"
#include "server/store/jobs/unit_store.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Units as rows of the journal; their blocks are rows as well, or parts of segment files.
class UnitRows final : public UnitStore {
 public:
  struct Options {
    std::int64_t segment_bytes = 0;  // size at which a new segment is started
    /// Size up to which a block is a row, and the total of such blocks of a job.
    std::int64_t max_row_bytes = 0, max_job_row_bytes = 0;
    std::function<std::int64_t()> now_us;
    std::function<void(const std::string&)> warn;
  };

  /// `folder`: of the segments.
  UnitRows(DurableFiles& files, Journal& journal, std::string folder, Options options);

  /// Sums up the sizes of the segments and deletes those without rows.
  absl::Status clean_up();

  absl::Status commit(std::vector<Commit>& group) override;
  absl::Status drop(const std::string& job_id, const std::vector<contract::Unit>& units) override;
  absl::Status set_audits(const std::string& job_id, const std::vector<contract::Unit>& units,
                          AuditState state) override;
  absl::Status close_job(const std::string& job_id) override;
  absl::Status for_each(const std::string& job_id,
                        const std::function<void(const UnitRecord&)>& visit) const override;
  absl::StatusOr<std::string> read_block(const std::string& job_id,
                                         const UnitRecord& record) const override;
  absl::StatusOr<std::vector<UnitTotals>> totals(const std::string& job_id) const override;

  /// Size of the segments.
  std::int64_t file_bytes() const { return file_bytes_; }
  /// Returns the size of a job's segments. `job`: JobKey::sequence. On the writing thread.
  absl::StatusOr<std::int64_t> file_bytes_of(std::int64_t job) const;
  /// Deletes the segments of a job whose rows are deleted; `bytes`: their size.
  void remove_files(const std::string& job_id, std::int64_t bytes);
  /// Deletes rows of units as a part of a transaction. Their bytes stay in the segments or rows,
  /// and in the size, until those are released.
  static absl::Status delete_units(Database& rows, std::int64_t job,
                                   const std::vector<contract::Unit>& units);

 private:
  bool fits_rows(const std::string& job_id, const std::vector<Commit*>& units) const;
  absl::Status append_job(const std::string& job_id, const JobKey& job,
                          const std::vector<Commit*>& units);
  static absl::Status add_up_units(Database& rows, std::int64_t job);
  static absl::Status insert_blocks(Database& rows, std::int64_t job,
                                    const std::vector<Commit*>& units);
  static absl::Status insert_units(Database& rows, const JobKey& job, std::int64_t hour,
                                   const std::vector<Commit*>& units);
  absl::StatusOr<std::string> read_row_block(std::int64_t id) const;

  DurableFiles& files_;
  Journal& journal_;
  const Options options_;
  Segments segments_;
  std::atomic<std::int64_t> file_bytes_ = 0;
  // Bytes of blocks that this process has committed, by jobs that are not closed; writer only.
  std::map<std::string, std::int64_t> job_bytes_;
};

}  // namespace tessera::server
