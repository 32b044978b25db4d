#pragma once

#include <string>
#include <vector>

#include "server/commit/commit_pipeline.h"
#include "server/frames/frame_finisher.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Carries out the outcomes of audits: records their end, drops the units of a faulty worker and
/// bans it, and adds warnings to the reports of jobs whose finished frames may contain its units.
/// Has no state.
class AuditOutcomes final : public EffectHandler {
 public:
  AuditOutcomes(FarmState& farm, Store& store, CommitPipeline& pipeline, FrameFinisher& finisher)
      : farm_(farm), store_(store), pipeline_(pipeline), finisher_(finisher) {}

  void carry_out(FarmChange& change, const Effects& effects) override;
  /// Drops the units of a worker in an unfinished frame; the frame is not finished before that.
  void redo_frame(FarmChange& change, const Job& job, std::int32_t frame,
                  const std::string& worker_id);

 private:
  void end_audit(FarmChange& change, const UnitName& unit);
  void quarantine(FarmChange& change, const std::string& worker_id);
  void log_failure(const char* what, const absl::Status& status) const;
  void doubt_frames(FarmChange& change, const Job& job, const std::vector<std::int32_t>& frames,
                    const std::string& worker_id);
  absl::Status write_doubts(const std::string& job_id, const std::vector<std::int32_t>& frames,
                            const std::string& worker_id);
  void redo_now(const FrameKey& key, const std::string& worker_id);

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  FrameFinisher& finisher_;
};

}  // namespace tessera::server
