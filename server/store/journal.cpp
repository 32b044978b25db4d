#include "server/store/journal.h"

#include "server/store/schema.h"

namespace tessera::server {

Journal::Journal(DurableFiles& files, int checkpoint_pages)
    : files_(files), checkpoint_pages_(checkpoint_pages) {}

absl::StatusOr<std::unique_ptr<Journal>> Journal::open(const std::string& path, DurableFiles& files,
                                                       int checkpoint_pages) {
  // SQLite would make it readable by others; its log takes over the mode of this file.
  if (auto file = files.filesystem().open(path); !file.ok()) return file.status();
  std::unique_ptr<Journal> journal(new Journal(files, checkpoint_pages));
  const std::string vfs = files.filesystem().sqlite_vfs();
  auto writer = Database::open(path, vfs, Database::Mode::writer);
  if (!writer.ok()) return writer.status();
  journal->writer_ = *std::move(writer);
  if (absl::Status current = migrate(*journal->writer_); !current.ok()) return current;
  auto reader = Database::open(path, vfs, Database::Mode::reader);
  if (!reader.ok()) return reader.status();
  journal->reader_ = *std::move(reader);
  if (absl::Status counted = journal->count_pages(); !counted.ok()) return counted;
  return journal;
}

absl::Status Journal::write(const std::function<absl::Status(Database&)>& body) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  absl::Status status = after_sync(writer_->transact([&] { return body(*writer_); }));
  if (!status.ok()) return status;
  if (writer_->wal_pages() >= checkpoint_pages_) status = after_sync(writer_->checkpoint());
  return status.ok() ? count_pages() : status;
}

absl::Status Journal::read(const std::function<absl::Status(Database&)>& body) const {
  const MutexLock lock(reader_mutex_);
  return body(*reader_);
}

absl::Status Journal::count_pages() {
  std::int64_t pages = 0;
  std::int64_t page_bytes = 0;
  absl::Status status =
      writer_->each("PRAGMA page_count", {}, [&](const SqlRow& row) { pages = row.integer(0); });
  if (!status.ok()) return status;
  status = writer_->each("PRAGMA page_size", {},
                         [&](const SqlRow& row) { page_bytes = row.integer(0); });
  used_bytes_ = pages * page_bytes;
  return status;
}

absl::Status Journal::after_sync(const absl::Status& status) {
  if (!absl::IsAborted(status)) return status;
  return files_.fail_sync(std::string(status.message()));
}

}  // namespace tessera::server
