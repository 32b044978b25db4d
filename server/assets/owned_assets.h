#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "contract/digest.h"
#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Assets that count towards the quotas of their owners: those that an owner's jobs name, each
/// once, and those that the owner has uploaded within the last hour. Plain data without a lock.
class OwnedAssets {
 public:
  /// Time for which an upload that no job names is kept, and counts.
  static constexpr auto kUploadAge = std::chrono::hours(1);

  /// Add and remove a job of the owner that names the asset.
  void add_job(const std::string& owner, const contract::Digest& digest, std::int64_t bytes);
  void remove_job(const std::string& owner, const contract::Digest& digest);
  /// Notes that the owner has begun, or repeated, an upload of the asset.
  void add_upload(const std::string& owner, const contract::Digest& digest, std::int64_t bytes,
                  Time now);
  /// Notes that the upload has failed.
  void drop_upload(const std::string& owner, const contract::Digest& digest);

  /// Returns the sum over the owner's assets, after forgetting uploads that are too old.
  std::int64_t bytes(const std::string& owner, Time now);
  /// The same, with one more asset of this size unless it counts already.
  std::int64_t bytes_with(const std::string& owner, const contract::Digest& digest,
                          std::int64_t bytes, Time now);

 private:
  struct Asset {
    std::int64_t bytes = 0;
    std::int64_t jobs = 0;
    std::optional<Time> uploaded;
  };
  struct Owner {
    std::int64_t bytes = 0;
    std::map<contract::Digest, Asset> assets;
    std::deque<std::pair<Time, contract::Digest>> uploads;  // in order of time
  };
  static Asset& count(Owner& owner, const contract::Digest& digest, std::int64_t bytes);
  static void erase_if_unused(Owner& owner, const contract::Digest& digest);

  std::map<std::string, Owner> owners_;
};

}  // namespace tessera::server
