#include "server/store/asset_files.h"

#include <algorithm>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kPinUs =
    std::int64_t{3600} * 1'000'000;  // time for which collect_assets() spares an upload
constexpr char kUploads[] = "upload";

}  // namespace

AssetFiles::AssetFiles(DurableFiles& files, Journal& journal, std::string folder,
                       std::function<std::int64_t()> now_us,
                       std::function<void(const std::string&)> warn)
    : files_(files),
      journal_(journal),
      folder_(std::move(folder)),
      now_us_(std::move(now_us)),
      warn_(std::move(warn)) {}

absl::Status AssetFiles::clean_up() {
  std::set<contract::Digest> known;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each("SELECT sha256, bytes FROM assets", {}, [&](const SqlRow& row) {
      used_bytes_ += row.integer(1);
      if (const auto digest = contract::Digest::from_binary(row.bytes(0))) known.insert(*digest);
    });
  });
  if (!status.ok()) return status;
  const auto names = files_.filesystem().list(folder_);
  if (!names.ok()) return names.status();
  for (const std::string& name : *names) clean_folder(name, known);
  // Uploads need not survive a crash, so this directory is never synced.
  return files_.filesystem().make_folder(absl::StrCat(folder_, "/", kUploads));
}

void AssetFiles::clean_folder(const std::string& name, const std::set<contract::Digest>& known) {
  const std::string folder = absl::StrCat(folder_, "/", name);
  const auto files = files_.filesystem().list(folder);
  if (!files.ok()) return warn_(absl::StrCat("skipped: ", std::string(files.status().message())));
  for (const std::string& file : *files) {
    const auto digest = contract::Digest::from_hex(name + file);
    if (digest.has_value() && known.count(*digest) != 0) continue;
    const absl::Status gone = files_.filesystem().remove(absl::StrCat(folder, "/", file));
    if (!gone.ok()) warn_(absl::StrCat("skipped: ", std::string(gone.message())));
  }
}

absl::StatusOr<std::int64_t> AssetFiles::recorded_bytes(const contract::Digest& digest) const {
  std::int64_t bytes = -1;
  const absl::Status status = journal_.read([&](Database& rows) {
    return rows.each("SELECT bytes FROM assets WHERE sha256=?", {blob_of(digest)},
                     [&](const SqlRow& row) { bytes = row.integer(0); });
  });
  if (!status.ok()) return status;
  return bytes;
}

bool AssetFiles::has(const contract::Digest& digest) const {
  const auto recorded = recorded_bytes(digest);
  if (!recorded.ok() || *recorded < 0) return false;  // if in doubt, it is uploaded again
  const auto stored = files_.filesystem().size_of(path(digest));
  // Errors but NotFound, such as a lack of descriptors, say nothing about the file.
  return stored.ok() ? *stored == *recorded : !absl::IsNotFound(stored.status());
}

std::string AssetFiles::path(const contract::Digest& digest) const {
  const std::string hex = digest.hex();
  return absl::StrCat(folder_, "/", hex.substr(0, 2), "/", hex.substr(2));
}

absl::StatusOr<std::string> AssetFiles::new_upload_path(std::int64_t boot_count) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  return absl::StrCat(folder_, "/", kUploads, "/", boot_count, "-", ++upload_count_);
}

absl::Status AssetFiles::publish(const std::string& upload_path, const contract::Digest& digest) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  const bool is_new = !has(digest);
  const auto recorded = recorded_bytes(digest);
  if (!recorded.ok()) return recorded.status();
  auto upload = files_.filesystem().open_existing(upload_path);
  if (!upload.ok()) return upload.status();
  const std::int64_t bytes = (*upload)->size();
  absl::Status status;
  if (is_new) {
    status = files_.sync(**upload);
    if (status.ok()) status = make_visible(upload_path, digest);
  } else {
    status = files_.filesystem().remove(upload_path);
  }
  if (!status.ok()) return status;
  const std::int64_t now = now_us_();
  status = journal_.write([&](Database& rows) {
    return rows.run(
        "INSERT INTO assets(sha256, bytes, kept_us) VALUES(?1, ?2, ?3) "
        "ON CONFLICT(sha256) DO UPDATE SET bytes=?2, kept_us=?3",
        {blob_of(digest), bytes, now});
  });
  if (status.ok()) used_bytes_ += bytes - std::max<std::int64_t>(*recorded, 0);
  return status;
}

absl::Status AssetFiles::make_visible(const std::string& upload_path,
                                      const contract::Digest& digest) {
  const std::string name = digest.hex().substr(0, 2);
  if (absl::Status made = files_.ensure_folder(folder_, name); !made.ok()) return made;
  absl::Status renamed = files_.filesystem().rename(upload_path, path(digest));
  if (!renamed.ok()) return renamed;
  return files_.sync_folder(absl::StrCat(folder_, "/", name));
}

absl::Status AssetFiles::release(const std::vector<contract::Digest>& digests) {
  const std::int64_t now = now_us_();
  return journal_.write([&](Database& rows) {
    for (const contract::Digest& digest : digests) {
      absl::Status noted =
          rows.run("UPDATE assets SET used_us=? WHERE sha256=?", {now, blob_of(digest)});
      if (!noted.ok()) return noted;
    }
    return absl::OkStatus();
  });
}

absl::Status AssetFiles::collect(std::int64_t now_us, std::int64_t quota_bytes,
                                 const std::vector<contract::Digest>& named) {
  std::vector<contract::Digest> pinned = named;
  std::sort(pinned.begin(), pinned.end());
  std::int64_t excess = used_bytes_ - quota_bytes;
  std::vector<std::pair<contract::Digest, std::int64_t>> victims;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT sha256, bytes FROM assets WHERE kept_us<=? "
        "ORDER BY MAX(kept_us, used_us), sha256",
        {now_us - kPinUs}, [&](const SqlRow& row) {
          const auto digest = contract::Digest::from_binary(row.bytes(0));
          if (excess <= 0 || !digest.has_value()) return;
          if (std::binary_search(pinned.begin(), pinned.end(), *digest)) return;
          victims.emplace_back(*digest, row.integer(1));
          excess -= row.integer(1);
        });
  });
  if (!status.ok() || victims.empty()) return status;
  // Rows first: a file without a row is an orphan, but a row without a file is damage.
  status = journal_.write([&](Database& rows) {
    for (const auto& victim : victims) {
      absl::Status gone = rows.run("DELETE FROM assets WHERE sha256=?", {blob_of(victim.first)});
      if (!gone.ok()) return gone;
    }
    return absl::OkStatus();
  });
  for (const auto& [digest, bytes] : victims) {
    if (!status.ok()) return status;
    used_bytes_ -= bytes;
    status = files_.filesystem().remove(path(digest));
  }
  return status;
}

}  // namespace tessera::server
