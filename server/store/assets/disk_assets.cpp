#include "server/store/assets/disk_assets.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/sqlite/digests.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kPinUs =
    std::int64_t{3600} * 1'000'000;  // time for which collect() spares an upload
constexpr char kUploads[] = "upload";

absl::Status write_row(Database& database, const contract::Digest& digest, std::int64_t bytes,
                       std::int64_t now_us) {
  return database.run(
      "INSERT INTO assets(sha256, bytes, kept_us) VALUES(?1, ?2, ?3) "
      "ON CONFLICT(sha256) DO UPDATE SET bytes=?2, kept_us=?3",
      {blob_of(digest), bytes, now_us});
}

absl::Status delete_contents(Database& database, const contract::Digest& digest) {
  return database.run("DELETE FROM asset_contents WHERE sha256=?", {blob_of(digest)});
}

}  // namespace

absl::Status AssetReader::read_at(std::int64_t offset, std::span<char> out) const {
  if (file_ != nullptr) return file_->read_at(offset, out);
  const std::int64_t left = size() - offset;
  if (offset < 0 || left < static_cast<std::int64_t>(out.size())) {
    return absl::OutOfRangeError(absl::StrCat("the asset ends at ", size()));
  }
  if (!out.empty()) std::memcpy(out.data(), &bytes_[static_cast<std::size_t>(offset)], out.size());
  return absl::OkStatus();
}

DiskAssets::DiskAssets(DurableFiles& files, Journal& journal, std::string folder, Options options)
    : files_(files), journal_(journal), folder_(std::move(folder)), options_(std::move(options)) {}

absl::Status DiskAssets::clean_up() {
  std::set<contract::Digest> known;  // files
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT sha256, bytes, sha256 IN (SELECT sha256 FROM asset_contents) FROM assets", {},
        [&](const SqlRow& row) {
          used_bytes_ += row.integer(1);
          if (row.integer(2) != 0) return;
          file_bytes_ += row.integer(1);
          if (const auto digest = contract::Digest::from_binary(row.bytes(0))) {
            known.insert(*digest);
          }
        });
  });
  if (!status.ok()) return status;
  const auto names = files_.filesystem().list(folder_);
  if (!names.ok()) return names.status();
  for (const std::string& name : *names) clean_folder(name, known);
  // Uploads need not survive a crash, so this directory is never synced.
  return files_.filesystem().make_folder(absl::StrCat(folder_, "/", kUploads));
}

void DiskAssets::clean_folder(const std::string& name, const std::set<contract::Digest>& known) {
  const auto skip = [&](const absl::Status& status) {
    options_.warn(absl::StrCat("skipped: ", std::string(status.message())));
  };
  const std::string folder = absl::StrCat(folder_, "/", name);
  const auto files = files_.filesystem().list(folder);
  if (!files.ok()) return skip(files.status());
  for (const std::string& file : *files) {
    const auto digest = contract::Digest::from_hex(name + file);
    if (digest.has_value() && known.count(*digest) != 0) continue;
    const absl::Status gone = files_.filesystem().remove(absl::StrCat(folder, "/", file));
    if (!gone.ok()) skip(gone);
  }
}

absl::StatusOr<DiskAssets::Rows> DiskAssets::find(Database& database,
                                                  const contract::Digest& digest) {
  Rows found;
  const absl::Status status = database.each(
      "SELECT bytes, IFNULL((SELECT length(contents) FROM asset_contents WHERE sha256=?1), -1) "
      "FROM assets WHERE sha256=?1",
      {blob_of(digest)}, [&](const SqlRow& row) {
        found = {row.integer(0), row.integer(1)};
      });
  if (!status.ok()) return status;
  return found;
}

bool DiskAssets::is_complete(const Rows& rows, const contract::Digest& digest) const {
  if (!rows.is_file()) return rows.asset_bytes >= 0 && rows.content_bytes == rows.asset_bytes;
  const auto stored = files_.filesystem().size_of(path(digest));
  // Errors but NotFound, such as a lack of descriptors, say nothing about the file.
  return stored.ok() ? *stored == rows.asset_bytes : !absl::IsNotFound(stored.status());
}

bool DiskAssets::has(const contract::Digest& digest) const {
  absl::StatusOr<Rows> found = Rows();
  const absl::Status status = journal_.read([&](Database& database) {
    found = find(database, digest);
    return found.status();
  });
  return status.ok() && is_complete(*found, digest);  // if in doubt, it is uploaded again
}

absl::StatusOr<AssetReader> DiskAssets::open(const contract::Digest& digest) const {
  std::optional<std::int64_t> stored_us;
  std::optional<std::string> contents;
  const absl::Status status = journal_.read([&](Database& database) {
    return database.each(
        "SELECT kept_us, contents FROM assets LEFT JOIN asset_contents USING (sha256) "
        "WHERE sha256=?",
        {blob_of(digest)}, [&](const SqlRow& row) {
          stored_us = row.integer(0);
          if (!row.is_null(1)) contents = row.text(1);
        });
  });
  if (!status.ok()) return status;
  if (!stored_us) return absl::NotFoundError(absl::StrCat("no asset ", digest.hex()));
  if (contents) return AssetReader(*std::move(contents), *stored_us);
  auto file = files_.filesystem().open_existing(path(digest));
  if (!file.ok()) return file.status();
  return AssetReader(std::unique_ptr<const File>(*std::move(file)), *stored_us);
}

std::string DiskAssets::path(const contract::Digest& digest) const {
  const std::string hex = digest.hex();
  return absl::StrCat(folder_, "/", hex.substr(0, 2), "/", hex.substr(2));
}

void DiskAssets::count(const Rows& before, const Rows& after) {
  const auto size = [](std::int64_t bytes) { return std::max<std::int64_t>(bytes, 0); };
  used_bytes_ += size(after.asset_bytes) - size(before.asset_bytes);
  file_bytes_ +=
      (after.is_file() ? after.asset_bytes : 0) - (before.is_file() ? before.asset_bytes : 0);
}

absl::Status DiskAssets::add(const contract::Digest& digest, std::string_view bytes) {
  const auto size = static_cast<std::int64_t>(bytes.size());
  Rows before, after;
  const std::int64_t now = options_.now_us();
  absl::Status status = journal_.write([&](Database& database) {
    const auto found = find(database, digest);  // the same asset may be in the same transaction
    if (!found.ok()) return found.status();
    before = after = *found;
    absl::Status written = write_row(database, digest, size, now);
    if (!written.ok() || is_complete(before, digest)) return written;
    after = {size, size};
    return database.run("INSERT OR REPLACE INTO asset_contents(sha256, contents) VALUES(?, ?)",
                        {blob_of(digest), Blob{bytes}});
  });
  if (!status.ok()) return status;
  journal_.after_write([this, before, after, digest] {
    count(before, after);
    const bool has_lost_file = before.is_file() && !after.is_file();
    if (has_lost_file) files_.note_deletion(files_.filesystem().remove(path(digest)));
  });
  return absl::OkStatus();
}

absl::StatusOr<std::string> DiskAssets::new_upload_path() {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  return absl::StrCat(folder_, "/", kUploads, "/", options_.boot_count, "-", ++upload_count_);
}

absl::Status DiskAssets::publish(const std::string& upload_path, const contract::Digest& digest) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  absl::StatusOr<Rows> before = Rows();
  absl::Status status = journal_.read_as_writer([&](Database& database) {
    before = find(database, digest);
    return before.status();
  });
  if (!status.ok()) return status;
  auto upload = files_.filesystem().open_existing(upload_path);
  if (!upload.ok()) return upload.status();
  const bool is_new = !is_complete(*before, digest);
  const Rows after = is_new ? Rows{(*upload)->size(), -1} : *before;
  if (is_new) {
    status = files_.sync(**upload);
    if (status.ok()) status = make_visible(upload_path, digest);
  } else {
    status = files_.filesystem().remove(upload_path);
  }
  if (!status.ok()) return status;
  status = journal_.write([&](Database& database) {
    absl::Status written = write_row(database, digest, after.asset_bytes, options_.now_us());
    if (written.ok() && is_new) written = delete_contents(database, digest);
    return written;
  });
  if (status.ok()) count(*before, after);
  return status;
}

absl::Status DiskAssets::make_visible(const std::string& upload_path,
                                      const contract::Digest& digest) {
  const std::string name = digest.hex().substr(0, 2);
  if (absl::Status made = files_.ensure_folder(folder_, name); !made.ok()) return made;
  absl::Status renamed = files_.filesystem().rename(upload_path, path(digest));
  if (!renamed.ok()) return renamed;
  return files_.sync_folder(absl::StrCat(folder_, "/", name));
}

absl::Status DiskAssets::release(const std::vector<contract::Digest>& digests) {
  const std::int64_t now = options_.now_us();
  return journal_.write([&](Database& rows) {
    for (const contract::Digest& digest : digests) {
      absl::Status noted =
          rows.run("UPDATE assets SET used_us=? WHERE sha256=?", {now, blob_of(digest)});
      if (!noted.ok()) return noted;
    }
    return absl::OkStatus();
  });
}

absl::StatusOr<std::vector<DiskAssets::Victim>> DiskAssets::find_victims(
    std::int64_t now_us, std::int64_t excess, const std::vector<contract::Digest>& named) const {
  std::vector<contract::Digest> pinned = named;
  std::sort(pinned.begin(), pinned.end());
  std::vector<Victim> victims;
  const absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT sha256, bytes, IFNULL(length(contents), -1) "
        "FROM assets LEFT JOIN asset_contents USING (sha256) WHERE kept_us<=? "
        "ORDER BY MAX(kept_us, used_us), sha256",
        {now_us - kPinUs}, [&](const SqlRow& row) {
          const auto digest = contract::Digest::from_binary(row.bytes(0));
          if (excess <= 0 || !digest.has_value()) return;
          if (std::binary_search(pinned.begin(), pinned.end(), *digest)) return;
          victims.push_back({*digest, {row.integer(1), row.integer(2)}});
          excess -= row.integer(1);
        });
  });
  if (!status.ok()) return status;
  return victims;
}

absl::Status DiskAssets::collect(std::int64_t now_us, std::int64_t quota_bytes,
                                 const std::vector<contract::Digest>& named) {
  const auto victims = find_victims(now_us, used_bytes_ - quota_bytes, named);
  return victims.ok() ? erase(*victims) : victims.status();
}

absl::Status DiskAssets::drop(const contract::Digest& digest, std::int64_t stored_us) {
  std::vector<Victim> victims;
  const absl::Status status = journal_.read_as_writer([&](Database& rows) {
    return rows.each(
        "SELECT bytes, IFNULL(length(contents), -1) "
        "FROM assets LEFT JOIN asset_contents USING (sha256) WHERE sha256=? AND kept_us=?",
        {blob_of(digest), stored_us}, [&](const SqlRow& row) {
          victims.push_back({digest, {row.integer(0), row.integer(1)}});
        });
  });
  return status.ok() ? erase(victims) : status;
}

absl::Status DiskAssets::erase(const std::vector<Victim>& victims) {
  if (victims.empty()) return absl::OkStatus();
  // Rows first: a file without a row is an orphan, but a row without a file is damage.
  absl::Status status = journal_.write([&](Database& rows) {
    for (const Victim& victim : victims) {
      absl::Status gone = rows.run("DELETE FROM assets WHERE sha256=?", {blob_of(victim.digest)});
      if (gone.ok()) gone = delete_contents(rows, victim.digest);
      if (!gone.ok()) return gone;
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  for (const Victim& victim : victims) {
    count(victim.rows, {});
    if (victim.rows.is_file())
      files_.note_deletion(files_.filesystem().remove(path(victim.digest)));
  }
  return absl::OkStatus();
}

}  // namespace tessera::server
