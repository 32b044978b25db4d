#include "server/store/sqlite/journal.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/sqlite/schema.h"

namespace tessera::server {

namespace {

constexpr int kPagesAtOnce = 256;  // released after a write; few, so that writes wait briefly

}  // namespace

Journal::Journal(DurableFiles& files, Upkeep upkeep) : files_(files), upkeep_(upkeep) {}

absl::StatusOr<std::unique_ptr<Journal>> Journal::open(const std::string& path, DurableFiles& files,
                                                       Upkeep upkeep) {
  // SQLite would create it readable by others; its log has the mode of this file.
  if (auto file = files.filesystem().open(path); !file.ok()) return file.status();
  std::unique_ptr<Journal> journal(new Journal(files, upkeep));
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
  if (is_together_) return writer_->transact_part([&] { return body(*writer_); });
  absl::Status status = after_sync(writer_->transact([&] { return body(*writer_); }));
  if (!status.ok()) return status;
  files_.note_sync(writer_->commit_seconds());
  return maintain();
}

absl::Status Journal::write_together(const std::function<void()>& body) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  absl::Status status = after_sync(writer_->transact([&] {
    is_together_ = true;
    body();
    is_together_ = false;
    return absl::OkStatus();
  }));
  const auto actions = std::exchange(after_together_, {});
  if (!status.ok()) return status;
  files_.note_sync(writer_->commit_seconds());
  status = maintain();
  if (!status.ok()) return status;
  for (const auto& action : actions) action();
  return absl::OkStatus();
}

void Journal::after_write(std::function<void()> action) {
  if (!is_together_) return action();
  after_together_.push_back(std::move(action));
}

/// The write is durable, so only a failed sync is an error. Maintenance that fails otherwise, for
/// example on a full disk, is left to the next write.
absl::Status Journal::maintain() {
  absl::Status status = count_pages();
  if (status.ok() && free_page_count_ > upkeep_.slack_pages && 4 * free_page_count_ > page_count_) {
    status = writer_->run(absl::StrCat("PRAGMA incremental_vacuum(", kPagesAtOnce, ")"));
    if (status.ok()) status = count_pages();
  }
  if (absl::IsAborted(status)) return after_sync(status);
  if (writer_->wal_pages() >= upkeep_.checkpoint_pages) status = writer_->checkpoint();
  return absl::IsAborted(status) ? after_sync(status) : absl::OkStatus();
}

absl::Status Journal::read(const std::function<absl::Status(Database&)>& body) const {
  const MutexLock lock(reader_mutex_);
  return body(*reader_);
}

absl::Status Journal::count_pages() {
  std::int64_t page_bytes = 0;
  for (const auto& [sql, place] : {std::pair{"PRAGMA page_count", &page_count_},
                                   std::pair{"PRAGMA freelist_count", &free_page_count_},
                                   std::pair{"PRAGMA page_size", &page_bytes}}) {
    absl::Status status =
        writer_->each(sql, {}, [value = place](const SqlRow& row) { *value = row.integer(0); });
    if (!status.ok()) return status;
  }
  used_bytes_ = page_count_ * page_bytes;
  return absl::OkStatus();
}

absl::Status Journal::after_sync(const absl::Status& status) {
  if (!absl::IsAborted(status)) return status;
  return files_.fail_sync(std::string(status.message()));
}

}  // namespace tessera::server
