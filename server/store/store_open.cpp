// Opening a store: lock, rows, boot count, and deletion of unfinished files.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "server/store/disk_store.h"
#include "server/store/files/names.h"
#include "server/store/sqlite/store_id.h"

namespace tessera::server {
namespace {

std::int64_t machine_time_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

void exit_with(const std::string& message) {
  std::fprintf(stderr, "tessera-server: %s\n", message.c_str());
  std::_Exit(1);  // without destructors, which would write; closing SQLite would sync again
}

StoreOptions with_defaults(StoreOptions options) {
  if (!options.now_us) options.now_us = machine_time_us;
  if (!options.fatal) options.fatal = exit_with;
  if (!options.warn) {
    options.warn = [](const std::string& line) {
      std::fprintf(stderr, "tessera-server: warning: %s\n", line.c_str());
    };
  }
  return options;
}

std::string parent_directory(const std::string& folder) {
  const std::size_t slash = folder.find_last_of('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : folder.substr(0, slash);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Store>> Store::open(const std::string& folder,
                                                   Filesystem& filesystem, StoreOptions options) {
  return DiskStore::open(folder, filesystem, with_defaults(std::move(options)));
}

absl::StatusOr<std::unique_ptr<Store>> DiskStore::open(const std::string& folder,
                                                       Filesystem& filesystem,
                                                       StoreOptions options) {
  std::string clean = folder;
  while (clean.size() > 1 && clean.back() == '/') clean.pop_back();
  if (clean.empty()) return absl::InvalidArgumentError("the store's directory is empty");
  std::unique_ptr<DiskStore> store(new DiskStore(clean, filesystem, std::move(options)));
  absl::Status status = store->make_folders();
  if (status.ok()) status = store->start();
  // A full disk shows as one of several errors of SQLite.
  if (!status.ok() && !absl::IsDataLoss(status) && !absl::IsFailedPrecondition(status) &&
      store->reserve_.give_up_to_start()) {
    store->options_.warn(absl::StrCat("the disk of the store ", clean, " is full: ",
                                      std::string(status.message()), "; remove jobs"));
    status = store->start();
  }
  if (status.ok()) status = store->clean_up();
  if (status.ok()) store->reserve_.set_up();
  if (!status.ok()) {
    return absl::Status(status.code(),
                        absl::StrCat("store ", clean, ": ", std::string(status.message())));
  }
  return store;
}

DiskStore::DiskStore(std::string folder, Filesystem& filesystem, StoreOptions options)
    : options_(std::move(options)),
      folder_(std::move(folder)),
      files_(filesystem, options_.fatal, options_.synced, options_.warn),
      reserve_(filesystem, folder_, options_.ballast_bytes) {}

absl::Status DiskStore::make_folders() {
  Filesystem& filesystem = files_.filesystem();
  if (absl::Status made = filesystem.make_folder(folder_); !made.ok()) return made;
  auto lock = filesystem.lock(absl::StrCat(folder_, "/lock"));
  if (!lock.ok()) return lock.status();
  lock_ = *std::move(lock);
  // These need no sync of folder_: SQLite syncs it with the first commit of every process, below,
  // because its log may be new.
  for (const char* name : {"/segments", "/assets", "/outputs"}) {
    absl::Status made = filesystem.make_folder(absl::StrCat(folder_, name));
    if (!made.ok()) return made;
  }
  return absl::OkStatus();
}

absl::Status DiskStore::start() {
  auto journal = Journal::open(absl::StrCat(folder_, "/store.db"), files_,
                               {options_.checkpoint_pages, options_.slack_pages});
  if (!journal.ok()) return journal.status();
  journal_ = *std::move(journal);
  const auto fresh = new_store_id();
  if (!fresh.ok()) return fresh.status();
  const auto read = [&] {
    return journal_->read_as_writer([&](Database& rows) {
      return rows.each("SELECT id, key, boot_count FROM store", {}, [&](const SqlRow& row) {
        id_ = row.text(0);
        key_ = row.text(1);
        boot_count_ = row.integer(2);
      });
    });
  };
  if (absl::Status status = read(); !status.ok()) return status;
  if (boot_count_ == 0) {
    absl::Status synced = files_.sync_folder(parent_directory(folder_));
    if (!synced.ok()) return synced;
  }
  // This commit also makes durable what a killed process committed but did not sync.
  events_ = std::make_unique<EventRows>(*journal_, options_.max_events);
  usage_ = std::make_unique<UsageRows>(*journal_);
  workers_ = std::make_unique<WorkerRows>(*journal_, options_.now_us);
  settings_ = std::make_unique<SettingsRows>(*journal_);
  if (absl::Status opened = events_->open(); !opened.ok()) return opened;
  const absl::Status counted = journal_->write([&](Database& rows) {
    return rows.run(
        "INSERT INTO store(one, id, key, boot_count) VALUES(1, ?, ?, 1) "
        "ON CONFLICT(one) DO UPDATE SET boot_count=boot_count+1",
        {fresh->id, Blob{fresh->key}});
  });
  return counted.ok() ? read() : counted;
}

absl::Status DiskStore::clean_up() {
  const auto in = [&](const char* name) { return absl::StrCat(folder_, "/", name); };
  assets_ = std::make_unique<DiskAssets>(
      files_, *journal_, in("assets"),
      DiskAssets::Options{options_.row_asset_bytes, boot_count_, options_.now_us, options_.warn});
  units_ = std::make_unique<UnitRows>(
      files_, *journal_, in("segments"),
      UnitRows::Options{options_.segment_bytes, options_.row_block_bytes,
                        options_.row_blocks_per_job_bytes, options_.now_us, options_.warn});
  frames_ =
      std::make_unique<FrameRows>(files_, *journal_, in("outputs"),
                                  FrameRows::Options{options_.row_image_bytes, options_.warn});
  jobs_ =
      std::make_unique<JobRows>(*journal_, reserve_, *units_, *frames_, options_.max_removed_jobs);
  if (absl::Status opened = jobs_->count_removed(); !opened.ok()) return opened;
  if (absl::Status cleaned = assets_->clean_up(); !cleaned.ok()) return cleaned;
  const absl::Status cleaned = units_->clean_up();
  remove_links();
  return cleaned.ok() ? frames_->clean_up() : cleaned;
}

/// Deletes what an interrupted backup has left (maintenance/backup.cpp). One that runs meanwhile
/// begins again.
void DiskStore::remove_links() {
  const auto names = files_.filesystem().list(folder_);
  if (!names.ok()) return;
  for (const std::string& name : *names) {
    if (!absl::StartsWith(name, kLinksPrefix)) continue;
    files_.remove_folder(absl::StrCat(folder_, "/", name)).IgnoreError();
  }
}

}  // namespace tessera::server
