#pragma once

#include "absl/status/status.h"
#include "server/commit/commit_pipeline.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Keeps FarmView::served_us() over restarts.
class ServiceTime {
 public:
  ServiceTime(FarmState& farm, Store& store, CommitPipeline& pipeline)
      : farm_(farm), store_(store), pipeline_(pipeline) {}

  /// Continues the time in the store, before any thread runs. Errors: those of the store.
  absl::Status load(FarmChange& change);
  /// Begins to write the time. A crash loses what has passed since it was last written.
  void write(FarmChange& change);

 private:
  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
};

}  // namespace tessera::server
