#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "contract/unit.h"

namespace tessera::server {

/// State of a committed unit's audit; the numbers are stored.
enum class AuditState : std::int32_t { none = 0, open = 1, ended = 2 };

/// A committed unit: location and cost of its block.
struct UnitRecord {
  contract::Unit unit;
  contract::Digest sha256;  // of the encoded block
  std::string worker_id;
  double cpu_seconds = 0;
  std::int64_t segment = 0, offset = 0, size_bytes = 0;  // set by the store; segment -1: in a row
  std::int64_t stored_bytes = 0;                         // size on disk
  AuditState audit = AuditState::none;
};

/// Sums over units of a finished job, by worker.
struct UnitTotals {
  std::string worker_id;
  std::int64_t units = 0, audited = 0;
  double cpu_seconds = 0;
};

/// A unit to commit, with its encoded block.
struct Commit {
  std::string job_id;
  UnitRecord record;
  std::string block;  // encoded film block
};

/// The committed units of jobs with their film blocks. One thread at a time may call writing
/// functions, that of Store; any thread may call reading functions.
class UnitStore {
 public:
  virtual ~UnitStore() = default;

  /// Appends and commits units as one group, all or none; durable on return. Sets their locations.
  ///
  /// Errors: NotFound, no such job; AlreadyExists, a unit is already committed; ResourceExhausted,
  /// the disk is full.
  virtual absl::Status commit(std::vector<Commit>& group) = 0;
  /// Removes committed units, to be rendered again, with their charge; durable on return.
  virtual absl::Status drop(const std::string& job_id,
                            const std::vector<contract::Unit>& units) = 0;
  /// Records the state of these units' audits; durable on return. Units that are not committed are
  /// left out.
  virtual absl::Status set_audits(const std::string& job_id,
                                  const std::vector<contract::Unit>& units, AuditState state) = 0;
  /// Closes a job whose frames are all finished: deletes its segments and replaces the rows of its
  /// units by sums per worker, so that the journal grows with jobs and not with units. Idempotent;
  /// units committed later start new segments. Errors: NotFound.
  virtual absl::Status close_job(const std::string& job_id) = 0;

  /// Calls `visit` for each committed unit of a job in order of (frame, tile, pass). `visit` must
  /// not call the store. An unknown job has no units.
  virtual absl::Status for_each(const std::string& job_id,
                                const std::function<void(const UnitRecord&)>& visit) const = 0;
  /// Returns the encoded block of a committed unit, verified against its digest.
  ///
  /// Errors: DataLoss, it is damaged (drop the unit and render it again); NotFound, the job is
  /// removed or its blocks are released.
  virtual absl::StatusOr<std::string> read_block(const std::string& job_id,
                                                 const UnitRecord& record) const = 0;
  /// Returns the sums of close_job() by worker ID. An unknown job has none.
  virtual absl::StatusOr<std::vector<UnitTotals>> totals(const std::string& job_id) const = 0;
};

}  // namespace tessera::server
