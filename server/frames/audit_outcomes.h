#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "server/commit/commit_pipeline.h"
#include "server/frames/frame_finisher.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Carries out the outcomes of audits: records their end, bans faulty workers and has their units
/// rendered again.
///
/// All consequences of a verdict are written in one transaction. If the server is killed before it,
/// the audit is still open after the restart and leads to the same verdict; after it, nothing is
/// left to do. Until the transaction is durable, no frame with units of the worker is finished
/// (JobFilm::suspect).
class AuditOutcomes final : public EffectHandler {
 public:
  AuditOutcomes(FarmState& farm, Store& store, CommitPipeline& pipeline, FrameFinisher& finisher)
      : farm_(farm), store_(store), pipeline_(pipeline), finisher_(finisher) {}

  void carry_out(FarmChange& change, const Effects& effects) override ABSL_LOCKS_EXCLUDED(mutex_);
  /// Notes a unit of a quarantined worker that was being committed when that was found faulty.
  void note_late_unit(FarmChange& change, const Job& job, std::int32_t frame,
                      const std::string& worker_id) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Writes again what could not be written.
  void tick() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  /// Faulty workers, and the audits that found them.
  struct Verdict {
    std::vector<std::string> faulty;
    std::vector<UnitName> audited;
  };
  /// The consequences of a verdict for one job.
  struct Consequence {
    JobKey key = 0;
    std::string job_id;
    std::map<std::int32_t, std::vector<contract::Unit>> dropped;  // by frame; may be empty
    std::map<std::int32_t, std::vector<std::string>> doubts;      // by finished frame
    absl::Status status;                                          // of its rows
  };

  void end_audit(FarmChange& change, const UnitName& unit);
  void quarantine(FarmChange& change, const std::string& worker_id);
  void settle() ABSL_LOCKS_EXCLUDED(mutex_);
  std::vector<Consequence> find_consequences(const Verdict& verdict);
  absl::Status write(const Verdict& verdict, std::vector<Consequence>& consequences);
  std::map<std::string, std::vector<std::string>> names_to_ban(const Verdict& verdict) const;
  absl::Status write_job(const Consequence& consequence);
  void apply(const Consequence& consequence);
  void release_frames(FarmChange& change, JobKey key);
  void postpone(const std::vector<Consequence>& consequences, const absl::Status& status)
      ABSL_LOCKS_EXCLUDED(mutex_);

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  FrameFinisher& finisher_;
  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kPart)
      ABSL_ACQUIRED_BEFORE(lock_order::kPipeline){lock_order::kPart};
  Verdict pending_ ABSL_GUARDED_BY(mutex_);  // not carried out yet
  bool is_postponed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace tessera::server
