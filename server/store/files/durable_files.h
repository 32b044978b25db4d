#pragma once

#include <functional>
#include <string>
#include <unordered_set>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "server/store/files/filesystem.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// A file system on which a failed sync ends the process.
///
/// After a failed fsync the kernel may have discarded the dirty pages and marked them clean: a
/// second fsync would succeed without proving anything, so there is none
/// (docs/explanation/fault-tolerance.md). Thread-safe.
class DurableFiles {
 public:
  /// `fatal` is called with a message when a sync fails and must not return; if it does, in a test,
  /// all later writes fail. `synced` is called with the duration of each sync of a file or journal,
  /// `warn` with a line about files that could not be deleted.
  DurableFiles(Filesystem& filesystem, std::function<void(const std::string&)> fatal,
               std::function<void(double seconds)> synced = {},
               std::function<void(const std::string&)> warn = {});

  Filesystem& filesystem() { return filesystem_; }

  /// Errors: DataLoss after a sync has failed.
  absl::Status check_healthy() const;
  /// Reports a failed sync; returns the status that check_healthy() gives from now on.
  absl::Status fail_sync(const std::string& message);

  absl::Status sync(File& file);
  /// Reports the duration of a sync that another library did.
  void note_sync(double seconds) const {
    if (synced_) synced_(seconds);
  }
  absl::Status sync_folder(const std::string& path);

  /// Creates `parent`/`name` and syncs the parent, once per process: an existing directory may come
  /// from a process that died before it synced.
  absl::Status ensure_folder(const std::string& parent, const std::string& name);
  /// Deletes a directory of files; succeeds if it is missing. Not durable: callers can repeat it.
  absl::Status remove_folder(const std::string& path);
  /// Warns if files to which no row points any more could not be deleted. That is no failure of the
  /// write before it, which is durable: they are orphans, which the next start deletes.
  void note_deletion(const absl::Status& outcome) const;

 private:
  Filesystem& filesystem_;
  std::function<void(const std::string&)> fatal_;
  std::function<void(double seconds)> synced_;
  std::function<void(const std::string&)> warn_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  bool broken_ ABSL_GUARDED_BY(mutex_) = false;
  std::unordered_set<std::string> durable_folders_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
