#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "server/store/files/durable_files.h"
#include "server/store/sqlite/database.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// The store's rows: a writing connection and a reading one.
class Journal {
 public:
  /// Thresholds of maintenance, in pages of 4 KiB.
  struct Upkeep {
    int checkpoint_pages = 0;  // length of the write-ahead log at which it is copied into the file
    int slack_pages = 0;       // free pages that the file may keep
  };
  /// Opens `path` and migrates its tables.
  static absl::StatusOr<std::unique_ptr<Journal>> open(const std::string& path, DurableFiles& files,
                                                       Upkeep upkeep);

  /// Runs `body` as one transaction; durable on return. One thread at a time.
  ///
  /// Errors: `body`'s own, after which nothing has changed; those of Database. A failed sync ends
  /// the process (DurableFiles).
  absl::Status write(const std::function<absl::Status(Database&)>& body);

  /// Runs `body`, whose calls of write() are parts of one transaction, durable on return; a part
  /// that fails leaves the others. On the writing thread; not within another.
  ///
  /// Errors: those of Database; then nothing has changed, whatever the parts returned.
  absl::Status write_together(const std::function<void()>& body);
  /// Does what must follow the last write, once that is durable: now, or at the end of
  /// write_together(), and not at all if that fails. An action has no error: what it cannot do must
  /// not make a durable write look as if it had failed.
  void after_write(std::function<void()> action);

  /// Runs queries. Any thread, one at a time; `body` must not call the journal.
  absl::Status read(const std::function<absl::Status(Database&)>& body) const;

  /// Runs queries on the writing thread, so that it need not wait for a long read().
  absl::Status read_as_writer(const std::function<absl::Status(Database&)>& body) const {
    return body(*writer_);
  }

  /// Size of the database file in bytes, without its log.
  std::int64_t used_bytes() const { return used_bytes_; }

 private:
  Journal(DurableFiles& files, Upkeep upkeep);
  absl::Status maintain();
  absl::Status count_pages();
  absl::Status after_sync(const absl::Status& status);

  DurableFiles& files_;
  const Upkeep upkeep_;
  std::unique_ptr<Database> writer_;
  mutable Mutex reader_mutex_ ABSL_ACQUIRED_AFTER(lock_order::kJournal)
      ABSL_ACQUIRED_BEFORE(lock_order::kLeaf){lock_order::kJournal};
  std::unique_ptr<Database> reader_ ABSL_PT_GUARDED_BY(reader_mutex_);
  bool is_together_ = false;  // write_together() runs
  std::vector<std::function<void()>> after_together_;
  std::int64_t page_count_ = 0, free_page_count_ = 0;
  std::atomic<std::int64_t> used_bytes_ = 0;
};

}  // namespace tessera::server
