#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/assets/asset_catalog.h"
#include "server/commit/commit_pipeline.h"
#include "server/report/job_view.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Checks that the owner of `spec` stays within its quotas with this new or changed job. `use`:
/// what the owner uses besides its jobs. Errors: ResourceExhausted.
absl::Status check_owners_quota(const FarmView& farm, const JobSpec& spec, OwnerUse use);

/// Errors: NotFound, a limit does not exist.
absl::Status check_limits_exist(const FarmView& farm, const std::vector<LimitUse>& uses);

/// Creates jobs: checks whether the client may have them, creates one per request ID, and answers
/// when the job is durable.
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
  /// Creates a job durably, then calls `done`. `visible_owner`: owner of the jobs that it may
  /// depend on; empty: all owners. Errors: as CreateJob in job_service.proto.
  void create_job(JobSpec spec, OnCreated done, std::string visible_owner = {});

 private:
  /// A job that is being created.
  struct Request {
    JobSpec spec;
    JobRecord record;
    std::int64_t store_bytes = 0;
    std::string visible_owner;
  };
  absl::Status write(const std::shared_ptr<Request>& request) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::StatusOr<std::optional<JobView>> find_existing(const JobSpec& spec) const;
  absl::Status check_room(const Request& request) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status check_disk(std::int64_t bytes) const;
  absl::Status check_new(const JobSpec& spec) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status check_owner(const JobSpec& spec) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status add_row(Request& request);
  absl::StatusOr<Created> answer(const std::shared_ptr<Request>& request,
                                 const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_);
  JobView add(const Request& request);
  std::string new_job_id();

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  AssetCatalog& assets_;

  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kAdmission)
      ABSL_ACQUIRED_BEFORE(lock_order::kFilm){lock_order::kAdmission};
  // Rows that are written, of jobs that the farm does not have yet.
  std::vector<std::shared_ptr<Request>> written_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
