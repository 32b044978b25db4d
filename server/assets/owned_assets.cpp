#include "server/assets/owned_assets.h"

namespace tessera::server {

OwnedAssets::Asset& OwnedAssets::count(Owner& owner, const contract::Digest& digest,
                                       std::int64_t bytes) {
  const auto [entry, is_new] = owner.assets.try_emplace(digest);
  if (is_new) {
    entry->second.bytes = bytes;
    owner.bytes += bytes;
  }
  return entry->second;
}

void OwnedAssets::erase_if_unused(Owner& owner, const contract::Digest& digest) {
  const auto found = owner.assets.find(digest);
  if (found == owner.assets.end()) return;
  if (found->second.jobs > 0 || found->second.uploaded) return;
  owner.bytes -= found->second.bytes;
  owner.assets.erase(found);
}

void OwnedAssets::add_job(const std::string& owner, const contract::Digest& digest,
                          std::int64_t bytes) {
  ++count(owners_[owner], digest, bytes).jobs;
}

void OwnedAssets::remove_job(const std::string& owner, const contract::Digest& digest) {
  Owner& its = owners_[owner];
  const auto found = its.assets.find(digest);
  if (found == its.assets.end()) return;
  --found->second.jobs;
  erase_if_unused(its, digest);
}

void OwnedAssets::add_upload(const std::string& owner, const contract::Digest& digest,
                             std::int64_t bytes, Time now) {
  Owner& its = owners_[owner];
  count(its, digest, bytes).uploaded = now;
  its.uploads.emplace_back(now, digest);
}

void OwnedAssets::drop_upload(const std::string& owner, const contract::Digest& digest) {
  Owner& its = owners_[owner];
  const auto found = its.assets.find(digest);
  if (found == its.assets.end()) return;
  found->second.uploaded.reset();
  erase_if_unused(its, digest);
}

std::int64_t OwnedAssets::bytes(const std::string& owner, Time now) {
  const auto found = owners_.find(owner);
  if (found == owners_.end()) return 0;
  Owner& its = found->second;
  while (!its.uploads.empty() && now - its.uploads.front().first > kUploadAge) {
    const auto [time, digest] = its.uploads.front();
    its.uploads.pop_front();
    const auto asset = its.assets.find(digest);
    if (asset == its.assets.end() || asset->second.uploaded != time) continue;  // repeated since
    asset->second.uploaded.reset();
    erase_if_unused(its, digest);
  }
  return its.bytes;
}

std::int64_t OwnedAssets::bytes_with(const std::string& owner, const contract::Digest& digest,
                                     std::int64_t bytes, Time now) {
  const std::int64_t sum = this->bytes(owner, now);
  const auto found = owners_.find(owner);
  const bool counts = found != owners_.end() && found->second.assets.count(digest) > 0;
  return counts ? sum : sum + bytes;
}

}  // namespace tessera::server
