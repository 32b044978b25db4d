#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "contract/film_block.h"
#include "contract/traversal_counts.h"
#include "server/commit/commit_pipeline.h"
#include "server/frames/audit_outcomes.h"
#include "server/frames/frame_finisher.h"
#include "server/intake/ingest_budget.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"
#include "server/telemetry/delivery_log.h"

namespace tessera::server {

/// Description of a block, sent before its bytes.
struct BlockHeader {
  Lease lease;
  std::int32_t tile = 0;
  std::int64_t size_bytes = 0;  // of the encoded block
  contract::Digest sha256;
  double cpu_seconds = 0;
  contract::TraversalCounts cost = {};

  contract::Unit unit() const { return {lease.frame, tile, lease.pass}; }
};

/// Properties of a block whose header was accepted.
struct Admission {
  contract::FilmBlockShape shape;
  std::int32_t sample_count = 0;
};

/// Takes a block from its header to its acknowledgement: checked on delivery, committed in a group
/// on the writer thread, acknowledged once it is durable, then merged.
class BlockIntake {
 public:
  /// The parts must outlive the intake.
  struct Parts {
    FarmState& farm;
    Store& store;
    CommitPipeline& pipeline;
    IngestBudget& budget;
    FrameFinisher& finisher;
    AuditOutcomes& audits;
    Budgets& budgets;
  };
  explicit BlockIntake(const Parts& parts)
      : farm_(parts.farm),
        store_(parts.store),
        pipeline_(parts.pipeline),
        budget_(parts.budget),
        finisher_(parts.finisher),
        audits_(parts.audits),
        budgets_(parts.budgets) {}

  /// Checks that a worker with this ID has a session under this certificate, and notes the contact.
  /// Errors: FailedPrecondition.
  absl::Status check_delivery(const std::string& worker_id, const std::string& certificate = {});
  /// Checks a block by its header. nullopt: it is acknowledged already and its bytes must be
  /// skipped.
  std::optional<Admission> admit(const std::string& worker_id, const BlockHeader& header);
  /// Takes an admitted block; its acknowledgement follows in the outbox. Checks the bytes without
  /// a lock.
  void deliver(const std::string& worker_id, const BlockHeader& header, const Admission& admission,
               std::string bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Returns whether more blocks may be read now. If not, `resume` is called once there is room.
  bool has_room_or_call(std::function<void()> resume) {
    return budget_.has_room_or_call(std::move(resume));
  }
  /// Number of blocks that wait for their commit or its answer.
  std::size_t block_count() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(mutex_);
    return delivered_.size() + committing_.size();
  }
  /// Recent deliveries.
  const DeliveryLog& deliveries() const { return deliveries_; }

 private:
  /// A delivered block that waits for the writer.
  struct Delivered {
    std::string worker_id;
    BlockHeader header;
    contract::FilmBlock block;
    std::string bytes;
  };
  /// Blocks of one job to commit, all or none.
  struct JobGroup {
    std::vector<Commit> commits;
    std::vector<Delivered> blocks;  // in the order of `commits`
    absl::Status status;
  };
  /// A group of delivered blocks.
  struct Group {
    bool is_checked = false;
    Time started;
    std::map<std::string, JobGroup> jobs;  // by job ID
    std::vector<Delivered> repeats;        // of units that are being committed
    std::int64_t bytes = 0;                // memory of the whole group
  };

  void acknowledge(FarmChange& change, const std::string& worker_id, const BlockHeader& header,
                   AckStatus status, const std::string& reason);
  void reject(FarmChange& change, const std::string& worker_id, const BlockHeader& header,
              const std::string& reason);
  void answer_obsolete(FarmChange& change, const std::string& worker_id, const BlockHeader& header);
  bool answer_duplicate(FarmChange& change, Job& job, const std::string& worker_id,
                        const BlockHeader& header);
  void answer_mismatch(const std::string& worker_id, const BlockHeader& header);
  std::optional<Admission> check_header(FarmChange& change, const std::string& worker_id,
                                        const BlockHeader& header);

  void post_commit();
  void commit_group(Group& group) ABSL_LOCKS_EXCLUDED(mutex_);
  void answer_group(Group& group, const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_);
  void forget_committing(const Group& group) ABSL_LOCKS_EXCLUDED(mutex_);
  void answer_repeat(FarmChange& change, const Delivered& block);
  std::vector<Delivered> next_blocks() ABSL_LOCKS_EXCLUDED(mutex_);
  void check_group(Group& group) ABSL_LOCKS_EXCLUDED(mutex_);
  void note_committed(FarmChange& change, Job& job, const UnitRecord& record, Delivered& block);
  void count_committed(FarmChange& change, Job& job, const UnitRecord& record,
                       std::int64_t samples);
  void warn_of_shared_certificate(FarmChange& change, Job& job, const std::string& worker_id);
  void note_failed(FarmChange& change, const std::string& job_id, const JobGroup& group);

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  IngestBudget& budget_;
  FrameFinisher& finisher_;
  AuditOutcomes& audits_;
  Budgets& budgets_;
  DeliveryLog deliveries_;

  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kPart)
      ABSL_ACQUIRED_BEFORE(lock_order::kPipeline){lock_order::kPart};
  std::vector<Delivered> delivered_ ABSL_GUARDED_BY(mutex_);
  std::set<UnitName> committing_ ABSL_GUARDED_BY(mutex_);  // in a group that is not answered yet
  bool is_commit_posted_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace tessera::server
