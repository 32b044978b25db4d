#include "server/store/maintenance/backup.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "server/store/files/names.h"
#include "server/store/sqlite/database.h"
#include "server/store/sqlite/schema.h"
#include "server/store/sqlite/store_id.h"

namespace tessera::server {
namespace {

constexpr int kMaxTries = 3, kMaxSnapshots = 20;
constexpr std::size_t kChunkBytes = std::size_t{1} << 20;

std::string parent_directory(const std::string& path) {
  const std::size_t slash = path.find_last_of('/');
  return slash == std::string::npos ? "." : path.substr(0, std::max<std::size_t>(slash, 1));
}

/// Returns a name that no other backup has.
std::string random_name() {
  const auto fresh = new_store_id();
  return fresh.ok() ? fresh->id : "links";
}

/// Deletes a failed attempt: files in at most two levels of directories.
void remove_all(Filesystem& filesystem, const std::string& path) {
  if (const auto names = filesystem.list(path); names.ok()) {
    for (const std::string& name : *names) remove_all(filesystem, absl::StrCat(path, "/", name));
  }
  (void)filesystem.remove(path);  // a remainder has the suffix .part
}

/// One attempt. NotFound: a file of the rows no longer exists because the server deleted it.
///
/// Rows are read as of one moment. Their files are linked into a directory of the store at once, in
/// which they stay when the server deletes them, and copied from there. Only a file that goes
/// between the moment and its link makes the attempt fail.
class Backup {
 public:
  Backup(std::string from, std::string to, Filesystem& filesystem)
      : from_(std::move(from)),
        to_(std::move(to)),
        links_(absl::StrCat(from_, "/", kLinksPrefix, random_name())),
        filesystem_(filesystem) {}

  ~Backup() { remove_all(filesystem_, links_); }
  Backup(const Backup&) = delete;
  Backup& operator=(const Backup&) = delete;

  absl::Status run() {
    absl::Status status = filesystem_.make_folder(to_);
    if (status.ok()) status = take_snapshot();
    if (!status.ok()) return status;
    auto rows = Database::open(to_ + "/store.db", "", Database::Mode::writer);
    if (!rows.ok()) return rows.status();
    status = check_schema(**rows);
    if (status.ok()) status = assign_new_id(**rows);
    if (status.ok()) status = (*rows)->checkpoint();
    rows->reset();
    for (auto file = files_.begin(); status.ok() && file != files_.end(); ++file) {
      status = copy_file(*file);
    }
    if (status.ok()) status = copy_tokens();
    if (status.ok()) status = sync_rows();
    return status.ok() ? sync_folders() : status;
  }

 private:
  /// Copies the rows in one transaction, which does not block the writer, and links their files.
  absl::Status take_snapshot() {
    const auto rows = Database::open(from_ + "/store.db", "", Database::Mode::reader);
    if (!rows.ok()) return rows.status();
    absl::Status status;
    for (int i = 0; i < kMaxSnapshots; ++i) {
      status = (*rows)->run("BEGIN");
      if (status.ok()) status = check_schema(**rows);
      if (status.ok()) status = list_files(**rows);
      if (status.ok()) status = link_files();
      if (status.ok()) status = (*rows)->copy_to(to_ + "/store.db");
      (*rows)->run("ROLLBACK").IgnoreError();
      if (!absl::IsNotFound(status)) return status;
    }
    return status;
  }

  /// Falls back to the files themselves where there are no hard links.
  absl::Status link_files() {
    remove_all(filesystem_, links_);
    has_links_ = filesystem_.make_folder(links_).ok();
    for (auto file = files_.begin(); has_links_ && file != files_.end(); ++file) {
      absl::Status linked = filesystem_.link(absl::StrCat(from_, "/", *file), link_of(*file));
      if (absl::IsNotFound(linked)) return linked;
      has_links_ = linked.ok();
    }
    if (!has_links_) remove_all(filesystem_, links_);
    return absl::OkStatus();
  }

  /// All links are in one directory, in which names of files are unique.
  std::string link_of(const std::string& name) const {
    std::string flat = name;
    std::replace(flat.begin(), flat.end(), '/', '~');  // which no name of a file contains
    return absl::StrCat(links_, "/", flat);
  }

  absl::Status sync_rows() {
    const auto rows = filesystem_.open_existing(to_ + "/store.db");
    return rows.ok() ? (*rows)->sync() : rows.status();
  }

  static absl::Status assign_new_id(Database& rows) {
    const auto fresh = new_store_id();
    if (!fresh.ok()) return fresh.status();
    return rows.run("UPDATE store SET id=?", {fresh->id});
  }

  absl::Status list_files(Database& rows) {
    files_.clear();
    // Segments, which are deleted soonest, come first. Segments before the first kept one are
    // released and may be deleted.
    for (const std::string_view sql :
         {"SELECT 'segments/' || id || '/' || segment || '.seg' FROM segments JOIN jobs "
          "ON job=sequence WHERE segment >= first_segment",
          "SELECT 'outputs/' || id || '/' || file FROM frames JOIN jobs ON job=sequence "
          "WHERE bytes > 0",
          "SELECT 'assets/' || substr(lower(hex(sha256)), 1, 2) || '/' || "
          "substr(lower(hex(sha256)), 3) FROM assets "
          "WHERE sha256 NOT IN (SELECT sha256 FROM asset_contents)"}) {
      absl::Status listed =
          rows.each(sql, {}, [&](const SqlRow& row) { files_.push_back(row.text(0)); });
      if (!listed.ok()) return listed;
    }
    return absl::OkStatus();
  }

  /// Copies `name`, DIRECTORY/GROUP/FILE. A segment may have grown since; bytes without a row are
  /// never read.
  absl::Status copy_file(const std::string& name) {
    const bool is_linked = has_links_ && !absl::StartsWith(name, "tokens/");
    const auto source =
        filesystem_.open_existing(is_linked ? link_of(name) : absl::StrCat(from_, "/", name));
    if (!source.ok()) return source.status();
    const std::string group = parent_directory(name);
    absl::Status status = filesystem_.make_folder(absl::StrCat(to_, "/", parent_directory(group)));
    if (status.ok()) status = filesystem_.make_folder(absl::StrCat(to_, "/", group));
    if (!status.ok()) return status;
    const auto target = filesystem_.open(absl::StrCat(to_, "/", name));
    if (!target.ok()) return target.status();
    std::vector<char> chunk(kChunkBytes);
    const std::int64_t bytes = (*source)->size();
    for (std::int64_t offset = 0; offset < bytes;) {
      const auto left = static_cast<std::size_t>(bytes - offset);
      const std::span<char> part(chunk.data(), std::min(left, chunk.size()));
      status = (*source)->read_at(offset, part);
      if (status.ok()) status = (*target)->append(std::string_view(part.data(), part.size()));
      if (!status.ok()) return status;
      offset += static_cast<std::int64_t>(part.size());
    }
    return (*target)->sync();
  }

  /// Copies the files of join tokens (identity/join_tokens.h), which have no rows.
  absl::Status copy_tokens() {
    const auto names = filesystem_.list(from_ + "/tokens");
    if (!names.ok()) return absl::OkStatus();  // there are none
    for (const std::string& name : *names) {
      const std::string token = "tokens/" + name;
      if (absl::Status copied = copy_file(token); !copied.ok() && !absl::IsNotFound(copied)) {
        return copied;
      }
    }
    return absl::OkStatus();
  }

  /// Syncs directories from the leaves up.
  absl::Status sync_folders() {
    std::vector<std::string> folders = {to_, parent_directory(to_)};
    for (const char* top : {"/segments", "/assets", "/outputs"}) {
      absl::Status made = filesystem_.make_folder(to_ + top);
      if (!made.ok()) return made;
      folders.push_back(to_ + top);
    }
    for (const std::string& name : files_)
      folders.push_back(absl::StrCat(to_, "/", parent_directory(name)));
    std::sort(folders.begin(), folders.end(), std::greater<>());
    folders.erase(std::unique(folders.begin(), folders.end()), folders.end());
    for (const std::string& folder : folders) {
      if (absl::Status synced = filesystem_.sync_folder(folder); !synced.ok()) return synced;
    }
    return absl::OkStatus();
  }

  const std::string from_, to_, links_;
  Filesystem& filesystem_;
  std::vector<std::string> files_;
  bool has_links_ = false;
};

}  // namespace

absl::StatusOr<StoreFindings> back_up_store(const std::string& folder, const std::string& copy,
                                            Filesystem& filesystem) {
  if (filesystem.list(copy).ok() || filesystem.open_existing(copy).ok()) {
    return absl::AlreadyExistsError(absl::StrCat(copy, " already exists"));
  }
  if (const auto rows = filesystem.open_existing(folder + "/store.db"); !rows.ok()) {
    return absl::NotFoundError(absl::StrCat(folder, " is not a store: ", rows.status().message()));
  }
  const std::string part = copy + ".part";
  std::string last_fault;
  for (int i = 0; i < kMaxTries; ++i) {
    remove_all(filesystem, part);
    const absl::Status copied = Backup(folder, part, filesystem).run();
    if (!copied.ok() && !absl::IsNotFound(copied)) {
      remove_all(filesystem, part);
      return copied;
    }
    last_fault = std::string(copied.message());
    if (!copied.ok()) continue;
    auto findings = check_store(part, filesystem);
    if (findings.ok() && findings->faults.empty()) {
      absl::Status status = filesystem.rename(part, copy);
      if (status.ok()) status = filesystem.sync_folder(parent_directory(copy));
      if (status.ok()) return findings;
      findings = status;
    }
    if (!findings.ok()) {
      remove_all(filesystem, part);
      return findings;
    }
    last_fault = findings->faults.front();  // a frame was replaced in the meantime, or damage
  }
  remove_all(filesystem, part);
  return absl::DataLossError(absl::StrCat(folder, " cannot be copied consistently: ", last_fault));
}

}  // namespace tessera::server
