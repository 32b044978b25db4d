#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "server/assets/owned_assets.h"
#include "server/commit/commit_pipeline.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Knows which assets are stored, who may read them and which must be kept, and deletes the others.
/// Thread-safe; its lock may be taken while the farm is locked.
class AssetCatalog {
 public:
  AssetCatalog(FarmState& farm, Store& store, CommitPipeline& pipeline)
      : farm_(farm), store_(store), pipeline_(pipeline) {}

  /// Returns whether the asset exists; protects it from deletion for an hour.
  bool has_asset(const contract::Digest& digest) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Returns a reader of an asset. Errors: NotFound.
  absl::StatusOr<AssetReader> open_asset(const contract::Digest& digest) const {
    return store_.assets().open(digest);
  }
  /// Size up to which an asset is uploaded into memory, for add_asset().
  std::int64_t max_row_bytes() const { return store_.assets().max_row_bytes(); }
  /// Stores a small upload. `done`: as of CommitPipeline.
  void add_asset(const contract::Digest& digest, std::string bytes, CommitPipeline::Answer done);
  absl::StatusOr<std::string> new_upload_path() { return store_.assets().new_upload_path(); }
  /// Stores a large upload.
  void publish_asset(const std::string& upload_path, const contract::Digest& digest,
                     CommitPipeline::Answer done);
  /// Returns whether the asset is a scene file of a job of which units were leased to workers with
  /// this certificate.
  bool is_leased_asset(const contract::Digest& digest, const std::string& certificate) const
      ABSL_LOCKS_EXCLUDED(mutex_);
  /// Notes that an asset was asked for and is not in the store: jobs with this scene file are
  /// leased only to workers that have it, until has_asset() finds it or it is stored again.
  void note_lost(const contract::Digest& digest) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Deletes an asset whose bytes, read by the reader with this time, are damaged, and notes that
  /// it is lost. `done`: as of CommitPipeline.
  void drop_damaged(const contract::Digest& digest, std::int64_t stored_us,
                    CommitPipeline::Answer done);
  /// Errors: FailedPrecondition, an asset that the job refers to is missing; InvalidArgument, it
  /// has another size than the manifest says.
  absl::Status check_present(const JobSpec& spec);
  /// Counts an asset that `owner` is about to upload towards its quota. Errors: ResourceExhausted.
  absl::Status begin_upload(const std::string& owner, const contract::Digest& digest,
                            std::int64_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Notes that an upload has failed.
  void drop_upload(const std::string& owner, const contract::Digest& digest)
      ABSL_LOCKS_EXCLUDED(mutex_);
  /// Returns the size of the assets that count towards the owner's quota: those of its jobs, and
  /// those that it has uploaded within the last hour.
  std::int64_t bytes_of(const std::string& owner) const ABSL_LOCKS_EXCLUDED(mutex_);
  /// Keeps the assets of a job.
  void add_job(JobKey key, const JobSpec& spec) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Releases the assets of removed jobs. On the writer thread.
  absl::Status release(const std::map<JobKey, std::shared_ptr<const JobSpec>>& jobs)
      ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  absl::StatusOr<std::int64_t> size_of(const contract::Digest& digest) ABSL_LOCKS_EXCLUDED(mutex_);
  void note_size(const contract::Digest& digest, std::int64_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  std::vector<JobKey> jobs_with(const contract::Digest& digest) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void mark_lost(const contract::Digest& digest) ABSL_LOCKS_EXCLUDED(mutex_);
  void note_found(const contract::Digest& digest) ABSL_LOCKS_EXCLUDED(mutex_);
  void forget_asked(Time now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool is_over_quota() const;
  void collect() ABSL_LOCKS_EXCLUDED(mutex_);

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  struct Asked {
    Time time;
    std::int64_t bytes = -1;  // negative: not known
  };
  /// Assets that were requested within about the last hour.
  std::map<contract::Digest, Asked> asked_ ABSL_GUARDED_BY(mutex_);
  /// Number of entries of asked_ at which those that are too old are removed.
  std::size_t max_asked_ ABSL_GUARDED_BY(mutex_) = 1000;
  /// Jobs that refer to the asset; true: as a file of their scene, which workers read.
  std::map<contract::Digest, std::map<JobKey, bool>> jobs_ ABSL_GUARDED_BY(mutex_);
  std::set<contract::Digest> lost_ ABSL_GUARDED_BY(mutex_);  // of jobs_, with note_lost()
  mutable OwnedAssets owned_ ABSL_GUARDED_BY(mutex_);        // reading it forgets old uploads
};

}  // namespace tessera::server
