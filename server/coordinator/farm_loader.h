#pragma once

#include <string>

#include "absl/status/status.h"
#include "server/assets/asset_catalog.h"
#include "server/commit/commit_pipeline.h"
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
  explicit FarmLoader(const Parts& parts) : parts_(parts) {}

  /// Loads jobs, units, frames and bans. A job that cannot be read fails, in memory only. Errors:
  /// those of the store.
  absl::Status load();

 private:
  absl::Status load_kept(FarmChange& change);
  absl::Status load_job(FarmChange& change, const JobRecord& record);
  void list_unreadable(FarmChange& change, const JobRecord& record, const absl::Status& fault);
  absl::Status note_removed(FarmChange& change, const std::string& job_id);
  absl::Status load_frames(FarmChange& change, Job& job);
  absl::Status load_units(FarmChange& change, Job& job, const JobRecord& record);

  const Parts parts_;
};

}  // namespace tessera::server
