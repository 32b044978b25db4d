#include "server/store/files/durable_files.h"

#include <chrono>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

namespace tessera::server {

DurableFiles::DurableFiles(Filesystem& filesystem, std::function<void(const std::string&)> fatal,
                           std::function<void(double seconds)> synced,
                           std::function<void(const std::string&)> warn)
    : filesystem_(filesystem),
      fatal_(std::move(fatal)),
      synced_(std::move(synced)),
      warn_(std::move(warn)) {}

absl::Status DurableFiles::check_healthy() const {
  const MutexLock lock(mutex_);
  if (!broken_) return absl::OkStatus();
  return absl::DataLossError("a sync to disk failed; reopen the store");
}

absl::Status DurableFiles::fail_sync(const std::string& message) {
  {
    const MutexLock lock(mutex_);
    broken_ = true;
  }
  fatal_(
      absl::StrCat("fsync failed; exiting, because a retry could report false success: ", message));
  return check_healthy();
}

absl::Status DurableFiles::sync(File& file) {
  const auto started = std::chrono::steady_clock::now();
  absl::Status synced = file.sync();
  note_sync(std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count());
  return synced.ok() ? synced : fail_sync(std::string(synced.message()));
}

absl::Status DurableFiles::sync_folder(const std::string& path) {
  absl::Status synced = filesystem_.sync_folder(path);
  // Other errors come from opening the directory, before any sync.
  if (!absl::IsDataLoss(synced)) return synced;
  return fail_sync(std::string(synced.message()));
}

absl::Status DurableFiles::ensure_folder(const std::string& parent, const std::string& name) {
  const std::string path = absl::StrCat(parent, "/", name);
  {
    const MutexLock lock(mutex_);
    if (durable_folders_.count(path) != 0) return absl::OkStatus();
  }
  if (absl::Status made = filesystem_.make_folder(path); !made.ok()) return made;
  if (absl::Status synced = sync_folder(parent); !synced.ok()) return synced;
  const MutexLock lock(mutex_);
  durable_folders_.insert(path);
  return absl::OkStatus();
}

absl::Status DurableFiles::remove_folder(const std::string& path) {
  const auto names = filesystem_.list(path);
  if (absl::IsNotFound(names.status())) return absl::OkStatus();
  if (!names.ok()) return names.status();
  for (const std::string& name : *names) {
    if (absl::Status gone = filesystem_.remove(absl::StrCat(path, "/", name)); !gone.ok()) {
      return gone;
    }
  }
  {
    const MutexLock lock(mutex_);
    durable_folders_.erase(path);
  }
  return filesystem_.remove(path);
}

void DurableFiles::note_deletion(const absl::Status& outcome) const {
  if (outcome.ok() || !warn_) return;
  warn_(absl::StrCat("files that are no longer needed remain until the next start: ",
                     std::string(outcome.message())));
}

}  // namespace tessera::server
