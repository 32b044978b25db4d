#include "server/assets/asset_catalog.h"

#include <algorithm>
#include <chrono>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr auto kAssetPin = std::chrono::hours(1);

}  // namespace

bool AssetCatalog::has_asset(const contract::Digest& digest) {
  if (!store_.assets().has(digest)) return false;
  const Time now = farm_.now();
  {
    const MutexLock lock(mutex_);
    asked_[digest].time = now;
    if (asked_.size() > max_asked_) forget_asked(now);
    if (lost_.count(digest) == 0) return true;
  }
  note_found(digest);
  return true;
}

/// Returns the jobs whose scenes the asset is a file of.
std::vector<JobKey> AssetCatalog::jobs_with(const contract::Digest& digest) const {
  std::vector<JobKey> keys;
  const auto found = jobs_.find(digest);
  if (found == jobs_.end()) return keys;
  for (const auto& [key, is_scene_file] : found->second) {
    if (is_scene_file) keys.push_back(key);
  }
  return keys;
}

void AssetCatalog::note_lost(const contract::Digest& digest) {
  mark_lost(digest);
  if (store_.assets().has(digest)) note_found(digest);  // it was stored since it was asked for
}

void AssetCatalog::drop_damaged(const contract::Digest& digest, std::int64_t stored_us,
                                CommitPipeline::Answer done) {
  pipeline_.post([this, digest, stored_us, done = std::move(done)] {
    farm_.log(LogLevel::error,
              absl::StrCat("asset ", digest.hex(), ": the stored bytes are damaged"));
    const absl::Status dropped = store_.assets().drop(digest, stored_us);
    if (dropped.ok()) note_lost(digest);
    done(dropped);
  });
}

void AssetCatalog::mark_lost(const contract::Digest& digest) {
  FarmChange change(farm_);
  std::vector<JobKey> keys;
  {
    const MutexLock lock(mutex_);
    keys = jobs_with(digest);
    if (!keys.empty()) lost_.insert(digest);
  }
  for (const JobKey key : keys) {
    Job* job = change.scheduler().jobs().find(key);
    if (job == nullptr || has_ended(job->state)) continue;
    const auto& assets = job->spec->assets;
    const auto file = std::find_if(assets.begin(), assets.end(),
                                   [&](const auto& entry) { return entry.digest == digest; });
    if (file == assets.end() || job->lost_asset == file->uri) continue;
    change.scheduler().changes().lose_asset(*job, file->uri);
    change.log(LogLevel::error,
               absl::StrCat("job ", job->spec->id, ": the store has lost ", file->uri, ", asset ",
                            digest.hex(), "; submit the scene again"));
  }
}

void AssetCatalog::note_found(const contract::Digest& digest) {
  {
    const MutexLock lock(mutex_);
    if (lost_.count(digest) == 0) return;
  }
  FarmChange change(farm_);
  std::vector<JobKey> keys;
  {
    const MutexLock lock(mutex_);
    lost_.erase(digest);
    keys = jobs_with(digest);
  }
  for (const JobKey key : keys) {
    Job* job = change.scheduler().jobs().find(key);
    if (job != nullptr) change.scheduler().changes().find_asset(*job, change.now());
  }
}

void AssetCatalog::forget_asked(Time now) {
  std::erase_if(asked_, [&](const auto& entry) { return now - entry.second.time > kAssetPin; });
  max_asked_ = 2 * asked_.size() + 1000;  // visits each entry a constant number of times
}

absl::Status AssetCatalog::check_present(const JobSpec& spec) {
  for (const ManifestEntry& entry : spec.assets) {
    if (!has_asset(entry.digest)) {
      return absl::FailedPreconditionError(
          absl::StrCat("manifest: asset ", entry.digest.hex(), " (", entry.uri,
                       ") has not been uploaded; upload it and repeat"));
    }
    const auto bytes = size_of(entry.digest);
    if (!bytes.ok()) return bytes.status();
    if (*bytes == entry.size_bytes) continue;
    return absl::InvalidArgumentError(absl::StrCat("manifest: asset ", entry.digest.hex(), " (",
                                                   entry.uri, ") has ", *bytes, " bytes, not ",
                                                   entry.size_bytes));
  }
  for (const contract::Digest& digest : spec.references) {
    if (has_asset(digest)) continue;
    return absl::FailedPreconditionError(absl::StrCat(
        "references: asset ", digest.hex(), " has not been uploaded; upload it and repeat"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::int64_t> AssetCatalog::size_of(const contract::Digest& digest) {
  {
    const MutexLock lock(mutex_);
    const auto found = asked_.find(digest);
    if (found != asked_.end() && found->second.bytes >= 0) return found->second.bytes;
  }
  const auto asset = store_.assets().open(digest);
  if (!asset.ok()) return asset.status();
  note_size(digest, asset->size());
  return asset->size();
}

void AssetCatalog::note_size(const contract::Digest& digest, std::int64_t bytes) {
  const Time now = farm_.now();
  const MutexLock lock(mutex_);
  asked_[digest] = {now, bytes};
}

absl::Status AssetCatalog::begin_upload(const std::string& owner, const contract::Digest& digest,
                                        std::int64_t bytes) {
  const double limit = farm_.options().client_quotas.of(owner).stored_gb;
  const QuotaKind& kind = quota_kind(&ClientQuota::stored_gb);
  const Time now = farm_.now();
  const FarmView view(farm_);
  const MutexLock lock(mutex_);
  OwnerUse use = view.owner_use(owner);
  use.kept_bytes += static_cast<double>(owned_.bytes_with(owner, digest, bytes, now));
  if (limit > 0 && use.of(kind) > limit) {
    farm_.metrics().quota_refused(kind.name);
    return over_quota(owner, kind, use.of(kind), limit);
  }
  owned_.add_upload(owner, digest, bytes, now);
  return absl::OkStatus();
}

void AssetCatalog::drop_upload(const std::string& owner, const contract::Digest& digest) {
  const MutexLock lock(mutex_);
  owned_.drop_upload(owner, digest);
}

std::int64_t AssetCatalog::bytes_of(const std::string& owner) const {
  const Time now = farm_.now();
  const MutexLock lock(mutex_);
  return owned_.bytes(owner, now);
}

void AssetCatalog::add_job(JobKey key, const JobSpec& spec) {
  const MutexLock lock(mutex_);
  for (const contract::Digest& digest : spec.references) jobs_[digest][key] = false;
  for (const ManifestEntry& entry : spec.assets) jobs_[entry.digest][key] = true;
  std::map<contract::Digest, std::int64_t> bytes;  // each asset once; of references it is not known
  for (const contract::Digest& digest : spec.references) bytes[digest] = 0;
  for (const ManifestEntry& entry : spec.assets) bytes[entry.digest] = entry.size_bytes;
  for (const auto& [digest, size] : bytes) owned_.add_job(spec.owner, digest, size);
}

absl::Status AssetCatalog::release(const std::map<JobKey, std::shared_ptr<const JobSpec>>& jobs) {
  std::set<contract::Digest> released;
  for (const auto& [key, spec] : jobs) {
    const std::vector<contract::Digest> digests = spec->asset_digests();
    released.insert(digests.begin(), digests.end());
    const MutexLock lock(mutex_);
    for (const contract::Digest& digest : std::set(digests.begin(), digests.end())) {
      owned_.remove_job(spec->owner, digest);
      const auto found = jobs_.find(digest);
      if (found == jobs_.end()) continue;
      found->second.erase(key);
      if (!found->second.empty()) continue;
      jobs_.erase(found);
      lost_.erase(digest);
    }
  }
  absl::Status status = store_.assets().release({released.begin(), released.end()});
  collect();
  return status;
}

bool AssetCatalog::is_leased_asset(const contract::Digest& digest,
                                   const std::string& certificate) const {
  const FarmView view(farm_);
  const MutexLock lock(mutex_);
  const auto found = jobs_.find(digest);
  if (found == jobs_.end()) return false;
  return view.scheduler().workers().has_leased(certificate, [jobs = &found->second](JobKey key) {
    const auto job = jobs->find(key);
    return job != jobs->end() && job->second;
  });
}

void AssetCatalog::add_asset(const contract::Digest& digest, std::string bytes,
                             CommitPipeline::Answer done) {
  const auto size = static_cast<std::int64_t>(bytes.size());
  pipeline_.post_write(
      [this, digest, bytes = std::move(bytes)] { return store_.assets().add(digest, bytes); },
      [this, digest, size, done = std::move(done)](const absl::Status& status) {
        if (status.ok()) {
          note_size(digest, size);
          note_found(digest);
        }
        if (is_over_quota()) pipeline_.post([this] { collect(); });
        done(status);
      });
}

void AssetCatalog::publish_asset(const std::string& upload_path, const contract::Digest& digest,
                                 CommitPipeline::Answer done) {
  pipeline_.post([this, upload_path, digest, done = std::move(done)] {
    const absl::Status status = store_.assets().publish(upload_path, digest);
    if (status.ok()) note_found(digest);
    collect();
    done(status);
  });
}

bool AssetCatalog::is_over_quota() const {
  return store_.assets().used_bytes() > farm_.options().asset_quota_bytes;
}

/// If the assets exceed their quota, deletes some that nobody needs. On the writer thread.
void AssetCatalog::collect() {
  if (!is_over_quota()) return;
  const Time now = farm_.now();
  std::vector<contract::Digest> named;
  {
    const MutexLock lock(mutex_);
    forget_asked(now);
    for (const auto& [digest, asked] : asked_) named.push_back(digest);
    for (const auto& [digest, keys] : jobs_) named.push_back(digest);
  }
  const absl::Status status =
      store_.assets().collect(farm_.options().wall_us(), farm_.options().asset_quota_bytes, named);
  if (!status.ok()) farm_.log(LogLevel::error, absl::StrCat("assets: ", status.ToString()));
}

}  // namespace tessera::server
