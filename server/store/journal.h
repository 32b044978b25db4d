#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "server/mutex.h"
#include "server/store/database.h"
#include "server/store/durable_files.h"

namespace tessera::server {

/// The store's rows: one connection that writes, one that reads.
class Journal {
 public:
  /// Opens `path` and brings its tables up to date. `checkpoint_pages`: length of the write-ahead
  /// log at which it is copied into the file.
  static absl::StatusOr<std::unique_ptr<Journal>> open(const std::string& path, DurableFiles& files,
                                                       int checkpoint_pages);

  /// Runs `body` as one transaction; durable on return. One thread at a time.
  ///
  /// Errors: `body`'s own, after which nothing has changed; those of Database. A failed sync ends
  /// the process (DurableFiles).
  absl::Status write(const std::function<absl::Status(Database&)>& body);

  /// Runs queries. Any thread, one after the other; `body` must not call the journal.
  absl::Status read(const std::function<absl::Status(Database&)>& body) const;

  /// Runs queries for the thread that writes, so that it need not wait for a long read().
  absl::Status read_as_writer(const std::function<absl::Status(Database&)>& body) const {
    return body(*writer_);
  }

  /// Bytes of the database file, without its log.
  std::int64_t used_bytes() const { return used_bytes_; }

 private:
  Journal(DurableFiles& files, int checkpoint_pages);
  absl::Status count_pages();
  absl::Status after_sync(const absl::Status& status);

  DurableFiles& files_;
  int checkpoint_pages_;
  std::unique_ptr<Database> writer_;
  mutable Mutex reader_mutex_;
  std::unique_ptr<Database> reader_ ABSL_PT_GUARDED_BY(reader_mutex_);
  std::atomic<std::int64_t> used_bytes_ = 0;
};

}  // namespace tessera::server
