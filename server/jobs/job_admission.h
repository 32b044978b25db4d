#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/assets/asset_catalog.h"
#include "server/commit/commit_pipeline.h"
#include "server/report/job_view.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Checks the quota of the owner of `spec` with this job in its new form. Errors:
/// ResourceExhausted.
absl::Status check_owners_quota(const FarmView& farm, const ClientQuota& quota,
                                const JobSpec& spec);

/// Creates jobs: who may have which, once per request, durable before the answer. Has no state.
class JobAdmission {
 public:
  JobAdmission(FarmState& farm, Store& store, CommitPipeline& pipeline, AssetCatalog& assets)
      : farm_(farm), store_(store), pipeline_(pipeline), assets_(assets) {}

  /// See tessera::server::check_client_priority().
  absl::Status check_client_priority(std::int32_t priority) const {
    return server::check_client_priority(farm_.options().policy, priority);
  }
  struct Created {
    JobView view;
    std::int64_t store_bytes = 0;
  };
  using OnCreated = std::function<void(absl::StatusOr<Created>)>;
  /// Creates a job durably, then calls `done`. Errors: as CreateJob in job_service.proto.
  void create_job(JobSpec spec, OnCreated done);

 private:
  absl::StatusOr<Created> create_now(const JobSpec& spec);
  absl::StatusOr<std::optional<JobView>> find_existing(const JobSpec& spec) const;
  absl::Status check_room(const JobSpec& spec, std::int64_t need_bytes);
  absl::Status add_row(JobRecord& record);
  std::string new_job_id();

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  AssetCatalog& assets_;
};

}  // namespace tessera::server
