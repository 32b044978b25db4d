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

/// Bytes that are not text, for SQLite. Looked at, not owned.
struct Blob {
  std::string_view bytes;
};

/// What a `?` of a statement stands for; text and blobs must outlive the call.
using SqlValue = std::variant<std::monostate, std::int64_t, double, std::string_view, Blob>;

/// A row of a result; valid during the visit only.
class SqlRow {
 public:
  explicit SqlRow(sqlite3_stmt* statement) : statement_(statement) {}
  std::int64_t integer(int column) const;
  double real(int column) const;
  std::string_view bytes(int column) const;  // text or blob
  std::string text(int column) const { return std::string(bytes(column)); }

 private:
  sqlite3_stmt* statement_;
};

/// One connection to an SQLite file in WAL mode; keeps its statements prepared.
///
/// One thread at a time. Every function's errors: DataLoss, the file is damaged or no database;
/// ResourceExhausted, the disk is full; AlreadyExists, a UNIQUE constraint; PermissionDenied;
/// Unavailable, locked elsewhere; Aborted, a sync failed; Internal for the rest.
class Database {
 public:
  enum class Mode { writer, reader };

  /// Opens a file. A writer makes it when it is missing or empty, turns it to WAL mode and syncs
  /// at every commit; it never checkpoints by itself, since SQLite would ignore a failed sync
  /// there.
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
  /// Runs statements separated by `;` that are not worth keeping prepared.
  absl::Status script(const char* sql);

  /// Commits what `body` did, or takes it all back when it returns an error.
  absl::Status transact(const std::function<absl::Status()>& body);

  /// Rows changed by the last run().
  std::int64_t changes() const;
  std::int64_t last_row_id() const;

  /// Pages in the write-ahead log after the last commit.
  int wal_pages() const { return wal_pages_; }
  /// Copies the log into the file as far as readers let it, and syncs both.
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
};

}  // namespace tessera::server
