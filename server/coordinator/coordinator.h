#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "absl/status/statusor.h"
#include "server/assets/asset_catalog.h"
#include "server/commit/commit_pipeline.h"
#include "server/frames/audit_outcomes.h"
#include "server/frames/frame_finisher.h"
#include "server/frames/frame_images.h"
#include "server/intake/block_intake.h"
#include "server/intake/ingest_budget.h"
#include "server/jobs/job_admin.h"
#include "server/jobs/job_admission.h"
#include "server/queries/farm_queries.h"
#include "server/settings/budgets.h"
#include "server/settings/client_shares.h"
#include "server/settings/farm_settings.h"
#include "server/settings/service_time.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/telemetry/health.h"
#include "server/workers/worker_registry.h"

namespace tessera::server {

/// Constructs the parts of a farm over a store, gives access to them, and runs them: the writer
/// thread, the answering thread, the film threads and the timer. Makes no decisions.
class Coordinator {
 public:
  /// Loads the jobs of the store. `store` must outlive the coordinator, which is its only writer.
  static absl::StatusOr<std::unique_ptr<Coordinator>> open(Store& store, FarmOptions options);

  // Threads.
  /// Body of the writer thread: writes what is pending; if `wait`, first waits until there is
  /// something. Returns whether it did anything. Call from one thread only.
  bool run_writer(bool wait) { return pipeline_.write(wait); }
  /// Body of the answering thread, like run_writer(): reports what the writer has written.
  bool run_answers(bool wait) { return pipeline_.answer(wait); }
  /// Body of each film thread, of which there are FarmOptions::film_threads: merges blocks and
  /// writes images until there is nothing to do; if `wait`, first waits until there is something.
  /// Without `wait`, does only what was queued before the call.
  bool run_film(bool wait) { return finisher_.tasks().run(wait); }
  /// Runs timeouts, leases and balancing; call about every tick_period.
  void tick();
  /// Ends waiting rounds. Further rounds without waiting still process what is queued.
  void stop();
  bool is_stopping() const { return pipeline_.is_stopping(); }

  // Parts.
  WorkerRegistry& workers() { return workers_; }
  BlockIntake& intake() { return intake_; }
  JobAdmission& admission() { return admission_; }
  JobAdmin& jobs() { return jobs_; }
  AssetCatalog& assets() { return assets_; }
  FarmSettings& settings() { return settings_; }
  Budgets& budgets() { return budgets_; }
  ClientShares& shares() { return shares_; }
  FrameImages& images() { return images_; }
  const FarmQueries& queries() const { return queries_; }
  /// The state of the farm, with its options, metrics and recent events. An event becomes visible
  /// just after the answer to the call that caused it.
  const FarmState& farm() const { return farm_; }
  /// Memory and lengths of the queues of the parts.
  struct MemoryUse {
    std::int64_t ingest_bytes = 0;  // at most FarmOptions::ingest_bytes and a block per stream
    std::int64_t film_bytes = 0;    // at most FarmOptions::film_memory_bytes, or one tile
    std::size_t connections = 0;    // open Work streams
    std::size_t blocks = 0;         // delivered and not answered
    std::size_t writes = 0;         // waiting for the writer or for their answers
    std::size_t film_tasks = 0;     // waiting for a film thread
  };
  MemoryUse memory_use() const;
  /// Signs of life of the threads.
  Health& health() { return health_; }

 private:
  Coordinator(Store& store, FarmOptions options, const std::vector<std::string>& roster);

  // In the order in which they use each other: queued tasks refer to the parts above their own.
  const Store& store_;
  FarmState farm_;
  Health health_;
  IngestBudget budget_;
  CommitPipeline pipeline_;
  Budgets budgets_;
  FrameFinisher finisher_;
  FrameImages images_;
  AuditOutcomes audits_;
  BlockIntake intake_;
  WorkerRegistry workers_;
  AssetCatalog assets_;
  FarmSettings settings_;
  ClientShares shares_;
  ServiceTime service_time_;
  JobAdmission admission_;
  JobAdmin jobs_;
  FarmQueries queries_;
  Time last_running_write_, last_writer_check_;  // timer thread only
};

}  // namespace tessera::server
