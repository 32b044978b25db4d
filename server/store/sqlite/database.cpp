#include "server/store/sqlite/database.h"

#include <sqlite3.h>

#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/files/filesystem.h"

namespace tessera::server {
namespace {

constexpr int kBusyTimeoutMs = 10'000;  // waits for this process's other connection only

absl::StatusCode status_code(int sqlite_code) {
  switch (sqlite_code) {
    case SQLITE_IOERR_FSYNC:
    case SQLITE_IOERR_DIR_FSYNC:
      return absl::StatusCode::kAborted;
    default:
      break;
  }
  switch (sqlite_code & 0xff) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::StatusCode::kDataLoss;
    case SQLITE_FULL:
    case SQLITE_NOMEM:
      return absl::StatusCode::kResourceExhausted;
    case SQLITE_CONSTRAINT:
      return absl::StatusCode::kAlreadyExists;
    case SQLITE_PERM:
    case SQLITE_AUTH:
    case SQLITE_READONLY:
    case SQLITE_CANTOPEN:
      return absl::StatusCode::kPermissionDenied;
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return absl::StatusCode::kUnavailable;
    default:
      return absl::StatusCode::kInternal;
  }
}

/// Binds by reference: values must outlive the run of the statement.
struct Binder {
  sqlite3_stmt* statement;
  int index;
  int operator()(std::monostate) const { return sqlite3_bind_null(statement, index); }
  int operator()(std::int64_t value) const { return sqlite3_bind_int64(statement, index, value); }
  int operator()(double value) const { return sqlite3_bind_double(statement, index, value); }
  int operator()(std::string_view value) const {
    // A null pointer would bind NULL instead of an empty text.
    return sqlite3_bind_text64(statement, index, value.empty() ? "" : value.data(), value.size(),
                               SQLITE_STATIC, SQLITE_UTF8);
  }
  int operator()(Blob value) const {
    return sqlite3_bind_blob64(statement, index, value.bytes.empty() ? "" : value.bytes.data(),
                               value.bytes.size(), SQLITE_STATIC);
  }
};

/// Resets a cached statement and clears its bindings.
class ResetLater {
 public:
  explicit ResetLater(sqlite3_stmt* statement) : statement_(statement) {}
  ~ResetLater() {
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);
  }
  ResetLater(const ResetLater&) = delete;
  ResetLater& operator=(const ResetLater&) = delete;

 private:
  sqlite3_stmt* statement_;
};

}  // namespace

std::int64_t SqlRow::integer(int column) const {
  return sqlite3_column_int64(statement_, column);
}

double SqlRow::real(int column) const {
  return sqlite3_column_double(statement_, column);
}

bool SqlRow::is_null(int column) const {
  return sqlite3_column_type(statement_, column) == SQLITE_NULL;
}

std::string_view SqlRow::bytes(int column) const {
  const auto* data = static_cast<const char*>(sqlite3_column_blob(statement_, column));
  const int size = sqlite3_column_bytes(statement_, column);
  return data == nullptr ? std::string_view() : std::string_view(data, static_cast<unsigned>(size));
}

void Database::Closer::operator()(sqlite3* connection) const {
  sqlite3_close_v2(connection);
}

void Database::Finalizer::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}

Database::Database(sqlite3* connection, std::string path)
    : path_(std::move(path)), connection_(connection) {}

Database::~Database() = default;

absl::StatusOr<std::unique_ptr<Database>> Database::open(const std::string& path,
                                                         const std::string& vfs, Mode mode) {
  sqlite3* connection = nullptr;
  const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE |
                    (mode == Mode::writer ? SQLITE_OPEN_CREATE : 0);
  const int code =
      sqlite3_open_v2(path.c_str(), &connection, flags, vfs.empty() ? nullptr : vfs.c_str());
  std::unique_ptr<Database> database(new Database(connection, path));
  if (code != SQLITE_OK) return database->error(code, "open");
  if (absl::Status configured = database->configure(mode); !configured.ok()) return configured;
  return database;
}

absl::Status Database::configure(Mode mode) {
  sqlite3_busy_timeout(connection_.get(), kBusyTimeoutMs);
  // Defensive: a manipulated schema must not trigger unexpected actions of SQLite.
  sqlite3_db_config(connection_.get(), SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(connection_.get(), SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  // A reader does not checkpoint, even if it closes last.
  if (mode == Mode::reader) {
    sqlite3_db_config(connection_.get(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
    return script("PRAGMA query_only=ON; PRAGMA temp_store=MEMORY");
  }
  // Takes effect for a new file. Others never shrink, but reuse their free pages.
  absl::Status status = script("PRAGMA auto_vacuum=INCREMENTAL");
  if (!status.ok()) return status;
  std::string journal;
  status = each("PRAGMA journal_mode=WAL", {}, [&](const SqlRow& row) { journal = row.text(0); });
  if (!status.ok()) return status;
  if (journal != "wal") {
    return absl::FailedPreconditionError(absl::StrCat(
        path_, ": the file system does not support SQLite's WAL (a network file system?)"));
  }
  status = script("PRAGMA synchronous=FULL; PRAGMA temp_store=MEMORY; PRAGMA foreign_keys=OFF");
  if (!status.ok()) return status;
  // Replaces SQLite's automatic checkpoint.
  sqlite3_wal_hook(
      connection_.get(),
      [](void* self, sqlite3*, const char*, int pages) {
        static_cast<Database*>(self)->wal_pages_ = pages;
        return SQLITE_OK;
      },
      this);
  return absl::OkStatus();
}

absl::Status Database::error(int code, std::string_view doing) const {
  if ((code & 0xff) == SQLITE_FULL) return disk_full(path_, doing);
  const char* reason =
      connection_ != nullptr ? sqlite3_errmsg(connection_.get()) : sqlite3_errstr(code);
  return absl::Status(status_code(code), absl::StrCat(path_, ": ", std::string(doing), ": ", reason,
                                                      " (SQLite code ", code, ")"));
}

absl::StatusOr<sqlite3_stmt*> Database::prepare(std::string_view sql) {
  const auto found = statements_.find(sql);
  if (found != statements_.end()) return found->second.get();
  sqlite3_stmt* statement = nullptr;
  const int code = sqlite3_prepare_v3(connection_.get(), sql.data(), static_cast<int>(sql.size()),
                                      SQLITE_PREPARE_PERSISTENT, &statement, nullptr);
  if (code != SQLITE_OK) return error(code, sql);
  statements_.emplace(std::string(sql), statement);
  return statement;
}

absl::Status Database::run(std::string_view sql, std::initializer_list<SqlValue> values) {
  return each(sql, values, [](const SqlRow&) {});
}

absl::Status Database::each(std::string_view sql, std::initializer_list<SqlValue> values,
                            const std::function<void(const SqlRow&)>& visit) {
  const auto prepared = prepare(sql);
  if (!prepared.ok()) return prepared.status();
  sqlite3_stmt* const statement = *prepared;
  const ResetLater reset(statement);
  int index = 0;
  for (const SqlValue& value : values) {
    ++index;
    const int bound = std::visit(Binder{statement, index}, value);
    if (bound != SQLITE_OK) return error(bound, sql);
  }
  int code = SQLITE_OK;
  while ((code = sqlite3_step(statement)) == SQLITE_ROW) visit(SqlRow(statement));
  return code == SQLITE_DONE ? absl::OkStatus() : error(code, sql);
}

absl::Status Database::script(const char* sql) {
  const int code = sqlite3_exec(connection_.get(), sql, nullptr, nullptr, nullptr);
  return code == SQLITE_OK ? absl::OkStatus() : error(code, sql);
}

absl::Status Database::transact(const std::function<absl::Status()>& body) {
  if (absl::Status status = run("BEGIN IMMEDIATE"); !status.ok()) return status;
  undone_ = absl::OkStatus();
  absl::Status status = body();
  if (!undone_.ok()) return undone_;
  const auto started = std::chrono::steady_clock::now();
  if (status.ok()) status = run("COMMIT");
  commit_seconds_ =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  if (!status.ok() && sqlite3_get_autocommit(connection_.get()) == 0) {
    run("ROLLBACK").IgnoreError();  // the first error is returned
  }
  return status;
}

absl::Status Database::copy_to(const std::string& path) {
  sqlite3* copy = nullptr;
  int code =
      sqlite3_open_v2(path.c_str(), &copy,
                      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_EXRESCODE, nullptr);
  const std::unique_ptr<sqlite3, Closer> closed_later(copy);
  if (code == SQLITE_OK) {
    sqlite3_backup* const backup = sqlite3_backup_init(copy, "main", connection_.get(), "main");
    if (backup == nullptr) {
      code = sqlite3_extended_errcode(copy);
    } else {
      sqlite3_backup_step(backup, -1);
      code = sqlite3_backup_finish(backup);
    }
  }
  if (code == SQLITE_OK) return absl::OkStatus();
  return absl::Status(status_code(code),
                      absl::StrCat(path, ": copy: ", copy != nullptr ? sqlite3_errmsg(copy) : "",
                                   " (SQLite code ", code, ")"));
}

absl::Status Database::transact_part(const std::function<absl::Status()>& body) {
  if (!undone_.ok()) return undone_;
  if (absl::Status status = run("SAVEPOINT part"); !status.ok()) return status;
  absl::Status status = body();
  if (status.ok()) status = run("RELEASE part");
  if (status.ok()) return status;
  if (sqlite3_get_autocommit(connection_.get()) != 0) {
    undone_ = status;
  } else {
    run("ROLLBACK TO part").IgnoreError();  // the first error is returned
    run("RELEASE part").IgnoreError();
  }
  return status;
}

std::int64_t Database::changes() const {
  return sqlite3_changes64(connection_.get());
}

std::int64_t Database::last_row_id() const {
  return sqlite3_last_insert_rowid(connection_.get());
}

absl::Status Database::checkpoint() {
  const int code = sqlite3_wal_checkpoint_v2(connection_.get(), nullptr, SQLITE_CHECKPOINT_PASSIVE,
                                             nullptr, nullptr);
  // Busy: a reader uses a part of the log, which stays until the next checkpoint.
  if (code == SQLITE_OK || (code & 0xff) == SQLITE_BUSY) return absl::OkStatus();
  return error(code, "checkpoint");
}

}  // namespace tessera::server
