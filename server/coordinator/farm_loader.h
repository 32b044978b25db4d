#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "server/assets/asset_catalog.h"
#include "server/commit/commit_pipeline.h"
#include "server/film/frame_summary.h"
#include "server/frames/frame_finisher.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Fills the farm with what the store holds, before any thread runs.
class FarmLoader {
 public:
  struct Parts {
    FarmState& farm;
    Store& store;
    CommitPipeline& pipeline;
    FrameFinisher& finisher;
    AssetCatalog& assets;
  };
  struct FinishedFrame {
    const FrameRecord& record;
    FrameSummary summary;
  };
  explicit FarmLoader(const Parts& parts) : parts_(parts) {}

  /// Loads jobs, units, frames and bans. A job that cannot be read fails, in memory only. One that
  /// is done and has lost frames is rendered again as far as they are missing. Errors: those of the
  /// store.
  absl::Status load();

 private:
  absl::Status load_kept(FarmChange& change);
  absl::Status load_job(FarmChange& change, const JobRecord& record);
  void list_unreadable(FarmChange& change, const JobRecord& record, const absl::Status& fault);
  absl::Status note_removed(FarmChange& change, const std::string& job_id);
  static void load_frames(FarmChange& change, Job& job, const std::vector<FinishedFrame>& frames);
  absl::Status load_units(FarmChange& change, Job& job, const JobRecord& record);

  const Parts parts_;
};

}  // namespace tessera::server
