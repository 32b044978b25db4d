#include "server/store/sqlite/schema.h"

#include <cstdint>
#include <iterator>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kApplicationId = 0x54535241;  // "TSRA", in the SQLite header

/// Step n brings version n to version n + 1. Steps are only ever added.
constexpr const char* kSteps[] = {
    R"sql(
CREATE TABLE store(
  one INTEGER PRIMARY KEY CHECK (one = 1),
  id TEXT NOT NULL,
  key BLOB NOT NULL,
  boot_count INTEGER NOT NULL);
CREATE TABLE jobs(
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  id TEXT NOT NULL UNIQUE,
  request_id TEXT UNIQUE,
  removed INTEGER NOT NULL DEFAULT 0,        -- the row stays, so that the ids stay taken
  first_segment INTEGER NOT NULL DEFAULT 0,  -- blocks in earlier segments are released
  name TEXT NOT NULL,
  owner TEXT NOT NULL,
  request BLOB NOT NULL,
  state INTEGER NOT NULL,
  reason TEXT NOT NULL,
  create_time_us INTEGER NOT NULL,
  end_time_us INTEGER NOT NULL,
  wall_seconds REAL NOT NULL);
CREATE TABLE units(
  job INTEGER NOT NULL,  -- jobs.sequence, as in the tables below
  frame INTEGER NOT NULL,
  tile INTEGER NOT NULL,
  pass INTEGER NOT NULL,
  segment INTEGER NOT NULL,
  offset INTEGER NOT NULL,
  size_bytes INTEGER NOT NULL,
  stored_bytes INTEGER NOT NULL,
  sha256 BLOB NOT NULL,
  worker TEXT NOT NULL,
  cpu_seconds REAL NOT NULL,
  PRIMARY KEY (job, frame, tile, pass)) WITHOUT ROWID;
CREATE TABLE segments(
  job INTEGER NOT NULL,
  segment INTEGER NOT NULL,
  bytes INTEGER NOT NULL,
  PRIMARY KEY (job, segment)) WITHOUT ROWID;
CREATE TABLE frames(
  job INTEGER NOT NULL,
  frame INTEGER NOT NULL,
  file TEXT NOT NULL,
  bytes INTEGER NOT NULL,
  file_sha256 BLOB NOT NULL,
  pixels_sha256 BLOB NOT NULL,
  statistics_json TEXT NOT NULL,
  PRIMARY KEY (job, frame)) WITHOUT ROWID;
CREATE TABLE assets(
  sha256 BLOB PRIMARY KEY,
  bytes INTEGER NOT NULL,
  kept_us INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE workers(
  id TEXT PRIMARY KEY,
  name TEXT NOT NULL) WITHOUT ROWID;
)sql",
    R"sql(
CREATE TABLE joins(
  worker TEXT NOT NULL,
  token TEXT NOT NULL,        -- its id
  certificate TEXT NOT NULL,  -- name of the worker's, which nobody else's worker takes over
  PRIMARY KEY (worker, token)) WITHOUT ROWID;
)sql",
    R"sql(
ALTER TABLE units ADD COLUMN audit INTEGER NOT NULL DEFAULT 0;  -- AuditState in store.h
)sql",
    R"sql(
CREATE TABLE bans(worker TEXT PRIMARY KEY) WITHOUT ROWID;  -- ids, found lying or banned
ALTER TABLE assets ADD COLUMN used_us INTEGER NOT NULL DEFAULT 0;  -- when a job last gave it up
)sql",
    R"sql(
CREATE TABLE totals(  -- what units without a row came to: those of jobs that are over
  job INTEGER NOT NULL,
  worker TEXT NOT NULL,
  units INTEGER NOT NULL,
  cpu_seconds REAL NOT NULL,
  audited INTEGER NOT NULL,
  PRIMARY KEY (job, worker)) WITHOUT ROWID;
INSERT INTO totals(job, worker, units, cpu_seconds, audited)
  SELECT job, worker, COUNT(*), TOTAL(cpu_seconds), COUNT(*) FILTER (WHERE audit=2)
  FROM units WHERE job IN (SELECT sequence FROM jobs WHERE state=4) GROUP BY job, worker;
DELETE FROM units WHERE job IN (SELECT sequence FROM jobs WHERE state=4);  -- DONE
ALTER TABLE joins ADD COLUMN seen_us INTEGER NOT NULL DEFAULT 0;  -- when the worker last was here
UPDATE joins SET seen_us=CAST(strftime('%s', 'now') AS INTEGER) * 1000000;
)sql",
    R"sql(
ALTER TABLE jobs ADD COLUMN render_contract INTEGER NOT NULL DEFAULT 10;  -- that of schema 5
)sql",
};

constexpr std::int64_t kSchemaVersion = std::size(kSteps);

absl::Status read_pragma(Database& database, std::string_view sql, std::int64_t& value) {
  return database.each(sql, {}, [&](const SqlRow& row) { value = row.integer(0); });
}

/// Errors: as migrate().
absl::Status read_version(Database& database, std::int64_t& version) {
  std::int64_t application = 0;
  absl::Status status = read_pragma(database, "PRAGMA user_version", version);
  if (status.ok()) status = read_pragma(database, "PRAGMA application_id", application);
  if (!status.ok()) return status;
  if (version < 0 || (version > 0 && application != kApplicationId)) {
    return absl::DataLossError("the store's database was not written by this program");
  }
  if (version > kSchemaVersion) {
    return absl::FailedPreconditionError(absl::StrCat("the store has schema ", version,
                                                      ", written by a newer version; this one ",
                                                      "reads up to ", kSchemaVersion));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status check_schema(Database& database) {
  std::int64_t version = 0;
  if (absl::Status status = read_version(database, version); !status.ok()) return status;
  if (version == kSchemaVersion) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(
      "the store has schema ", version, ", written by an older version; starting this version's ",
      "server on it once brings it up to ", kSchemaVersion));
}

absl::Status migrate(Database& database) {
  std::int64_t version = 0;
  absl::Status status = read_version(database, version);
  if (!status.ok()) return status;
  for (; version < kSchemaVersion; ++version) {
    status = database.transact([&] {
      absl::Status step = database.script(kSteps[version]);
      if (!step.ok()) return step;
      return database.script(absl::StrCat("PRAGMA application_id=", kApplicationId,
                                          "; PRAGMA user_version=", version + 1)
                                 .c_str());
    });
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace tessera::server
