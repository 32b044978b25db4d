#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/assets/asset_catalog.h"
#include "server/commit/commit_pipeline.h"
#include "server/frames/frame_finisher.h"
#include "server/report/job_view.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Errors: FailedPrecondition, the store's data of the job cannot be read.
absl::Status check_readable(const JobSpec& spec);
/// Errors: FailedPrecondition, the job's blocks have another render contract: passes and sampling
/// may differ, and all of a frame must have one contract.
absl::Status check_render_contract(const JobSpec& spec);

/// Changes, extends, removes and expires jobs. A change is answered when its row is written, with
/// the outcome of that write.
class JobAdmin {
 public:
  /// The parts must outlive the job admin.
  struct Parts {
    FarmState& farm;
    Store& store;
    CommitPipeline& pipeline;
    FrameFinisher& finisher;
    AssetCatalog& assets;
  };
  explicit JobAdmin(const Parts& parts)
      : farm_(parts.farm),
        store_(parts.store),
        pipeline_(parts.pipeline),
        finisher_(parts.finisher),
        assets_(parts.assets) {}

  using OnJob = std::function<void(absl::StatusOr<JobView>)>;
  enum class Change { pause, resume, cancel, retry };
  /// Changes a job, writes its row, then calls `done`. Errors: as the rpc of that name; if the row
  /// cannot be written, those of the store, and a restart undoes the change.
  void change_job(const std::string& job_id, Change what, const OnJob& done);
  /// New settings of an extended job; absent: unchanged.
  struct Extension {
    std::optional<std::int32_t> spp;
    std::optional<double> error;
  };
  /// Extends a job durably, then calls `done`. After an error nothing has changed.
  void extend_job(const std::string& job_id, const Extension& extension, OnJob done);
  /// New priority, requirements, limits and blocked workers of a job; absent: unchanged.
  struct Update {
    std::optional<std::int32_t> priority, max_workers;
    std::optional<std::string> required_tag, pool;
    std::optional<std::vector<LimitUse>> limits;
    std::vector<std::string> block_workers, unblock_workers;
    bool clear_dependencies = false;
  };
  /// Changes a job that is not done durably, then calls `done`. After an error nothing has changed.
  void update_job(const std::string& job_id, const Update& update, OnJob done);
  /// Removes an ended job durably, then calls `done`. After an error the job is still there.
  void remove_job(const std::string& job_id, std::function<void(absl::Status)> done);
  /// Removes jobs that ended long ago, and resumes jobs that were paused because the disk was full
  /// when it has room. Call at each tick.
  void tick(FarmChange& change);
  /// Returns whether there were such jobs at the last check. Call where tick() is called.
  bool has_waiting() const { return has_waiting_; }

 private:
  void change_now(const std::string& job_id, Change what, const OnJob& done);
  absl::Status apply(FarmChange& change, Job& job, Change what);
  absl::StatusOr<std::shared_ptr<JobSpec>> spec_to_extend(const std::string& job_id,
                                                          const Extension& extension) const;
  absl::StatusOr<JobView> extend_now(const std::string& job_id, const Extension& extension);
  JobView replan(const std::string& job_id, const std::shared_ptr<const JobSpec>& spec,
                 const std::vector<UnitRecord>& kept, const std::vector<contract::Unit>& redone);
  absl::StatusOr<JobView> update_now(const std::string& job_id, const Update& update);
  absl::StatusOr<Event> removal_of(const std::string& job_id) const;
  std::vector<absl::Status> remove_now(const std::vector<std::string>& job_ids);
  std::shared_ptr<const JobSpec> forget(FarmChange& change, const std::string& job_id);
  void expire_jobs(FarmChange& change);
  void expire(const std::vector<std::string>& job_ids);
  void resume_waiting();

  /// Returns what the owner's assets use of its quotas.
  OwnerUse assets_use(const std::string& owner) const {
    OwnerUse use;
    use.kept_bytes = static_cast<double>(assets_.bytes_of(owner));
    return use;
  }

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  FrameFinisher& finisher_;
  AssetCatalog& assets_;
  // Guarded by the farm's lock.
  Time last_tick_;
  bool is_expiring_ = false;  // the writer removes jobs, or will
  bool has_waiting_ = false;
};

}  // namespace tessera::server
