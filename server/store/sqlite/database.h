#pragma once

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <variant>

#include "absl/status/statusor.h"

struct sqlite3;
struct sqlite3_stmt;

namespace tessera::server {

/// Bytes for SQLite that are not text; not owned.
struct Blob {
  std::string_view bytes;
};

/// Value of a `?` in a statement; text and blobs must outlive the call.
using SqlValue = std::variant<std::monostate, std::int64_t, double, std::string_view, Blob>;

/// A row of a result; valid during the visit only.
class SqlRow {
 public:
  explicit SqlRow(sqlite3_stmt* statement) : statement_(statement) {}
  std::int64_t integer(int column) const;
  double real(int column) const;
  bool is_null(int column) const;
  std::string_view bytes(int column) const;  // text or blob
  std::string text(int column) const { return std::string(bytes(column)); }

 private:
  sqlite3_stmt* statement_;
};

/// A connection to an SQLite file in WAL mode; caches prepared statements.
///
/// One thread at a time. Errors of all functions: DataLoss, the file is damaged or not a database;
/// ResourceExhausted, the disk is full; AlreadyExists, a UNIQUE constraint; PermissionDenied;
/// Unavailable, locked by another process; Aborted, a sync failed; Internal otherwise.
class Database {
 public:
  enum class Mode { writer, reader };

  /// Opens a file. A writer creates it if it is missing or empty, switches it to WAL mode and syncs
  /// at every commit. It never checkpoints automatically, because SQLite would ignore a failed
  /// sync.
  static absl::StatusOr<std::unique_ptr<Database>> open(const std::string& path,
                                                        const std::string& vfs, Mode mode);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  /// Runs a statement that returns no rows.
  absl::Status run(std::string_view sql, std::initializer_list<SqlValue> values = {});
  /// Runs a query and visits each row.
  absl::Status each(std::string_view sql, std::initializer_list<SqlValue> values,
                    const std::function<void(const SqlRow&)>& visit);
  /// Runs statements separated by `;` without caching them.
  absl::Status script(const char* sql);

  /// Runs `body` as a transaction: commits, or rolls back if it returns an error.
  absl::Status transact(const std::function<absl::Status()>& body);
  /// Runs `body` as a part of the transaction that is open: if it returns an error, only the part
  /// is undone. If SQLite has undone the whole transaction, all further parts and the transaction
  /// fail with that error. Requires: within transact().
  absl::Status transact_part(const std::function<absl::Status()>& body);

  /// Copies the database into a new file. Inside of a transaction that has read, the copy is of the
  /// same snapshot.
  absl::Status copy_to(const std::string& path);

  /// Rows changed by the last run().
  std::int64_t changes() const;
  std::int64_t last_row_id() const;

  /// Duration of the COMMIT of the last transact(): a sync of the write-ahead log.
  double commit_seconds() const { return commit_seconds_; }
  /// Pages in the write-ahead log after the last commit.
  int wal_pages() const { return wal_pages_; }
  /// Copies the log into the file as far as readers allow, and syncs both.
  absl::Status checkpoint();

 private:
  struct Closer {
    void operator()(sqlite3* connection) const;
  };
  struct Finalizer {
    void operator()(sqlite3_stmt* statement) const;
  };

  Database(sqlite3* connection, std::string path);
  absl::Status configure(Mode mode);
  absl::StatusOr<sqlite3_stmt*> prepare(std::string_view sql);
  absl::Status error(int code, std::string_view doing) const;

  std::string path_;
  std::unique_ptr<sqlite3, Closer> connection_;
  std::map<std::string, std::unique_ptr<sqlite3_stmt, Finalizer>, std::less<>> statements_;
  int wal_pages_ = 0;
  double commit_seconds_ = 0;
  absl::Status undone_;  // why SQLite has undone the open transaction; OK: it has not
};

}  // namespace tessera::server
