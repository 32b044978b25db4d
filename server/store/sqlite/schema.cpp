#include "server/store/sqlite/schema.h"

#include <cstdint>
#include <iterator>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kApplicationId = 0x54535241;  // "TSRA", in the SQLite header

/// Step n migrates schema version n to n + 1. Released steps never change.
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
  removed INTEGER NOT NULL DEFAULT 0,        -- the newest rows stay, so that the IDs stay taken
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
  token TEXT NOT NULL,        -- its ID
  certificate TEXT NOT NULL,  -- its name; no other certificate may use the worker ID
  PRIMARY KEY (worker, token)) WITHOUT ROWID;
)sql",
    R"sql(
ALTER TABLE units ADD COLUMN audit INTEGER NOT NULL DEFAULT 0;  -- AuditState in store.h
)sql",
    R"sql(
CREATE TABLE bans(worker TEXT PRIMARY KEY) WITHOUT ROWID;  -- IDs of banned or quarantined workers
ALTER TABLE assets ADD COLUMN used_us INTEGER NOT NULL DEFAULT 0;  -- when the last job that used it was removed
)sql",
    R"sql(
CREATE TABLE totals(  -- sums over units of finished jobs, whose rows are deleted
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
ALTER TABLE joins ADD COLUMN seen_us INTEGER NOT NULL DEFAULT 0;  -- when the worker was last connected
UPDATE joins SET seen_us=CAST(strftime('%s', 'now') AS INTEGER) * 1000000;
)sql",
    R"sql(
ALTER TABLE jobs ADD COLUMN render_contract INTEGER NOT NULL DEFAULT 10;  -- that of schema 5
)sql",
    R"sql(
ALTER TABLE jobs ADD COLUMN failure_code INTEGER NOT NULL DEFAULT 0;  -- status code of a failed job
UPDATE jobs SET failure_code=3 WHERE state=5 AND reason LIKE 'bad scene:%';  -- INVALID_ARGUMENT
)sql",
    R"sql(
CREATE TABLE blocks(  -- small blocks; units.segment is -1 and units.offset is the id
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  job INTEGER NOT NULL,
  block BLOB NOT NULL);
CREATE INDEX blocks_of_job ON blocks(job);
CREATE TABLE images(  -- small images, which have no file; their frames.bytes is 0
  job INTEGER NOT NULL,
  frame INTEGER NOT NULL,
  image BLOB NOT NULL,
  PRIMARY KEY (job, frame));
)sql",
    R"sql(
CREATE TABLE settings(  -- of the farm
  kind INTEGER NOT NULL,  -- SettingKind in store.h
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (kind, name)) WITHOUT ROWID;
)sql",
    R"sql(
CREATE TABLE asset_contents(  -- of small assets, which have no file
  sha256 BLOB PRIMARY KEY,
  contents BLOB NOT NULL);
)sql",
    R"sql(
ALTER TABLE jobs ADD COLUMN project TEXT NOT NULL DEFAULT '';          -- that its use is charged to
ALTER TABLE jobs ADD COLUMN failed_attempts TEXT NOT NULL DEFAULT '';  -- JSON; see server/state
CREATE TABLE usage(  -- of committed units, also of jobs that are removed
  hour INTEGER NOT NULL,  -- since 1970, of their commit
  job INTEGER NOT NULL,
  units INTEGER NOT NULL,
  cpu_seconds REAL NOT NULL,
  PRIMARY KEY (hour, job)) WITHOUT ROWID;
ALTER TABLE units ADD COLUMN hour INTEGER NOT NULL DEFAULT 0;  -- in which it is charged
-- What was committed before is charged in the hour of the job's submission.
UPDATE units SET hour=(SELECT create_time_us / 3600000000 FROM jobs WHERE sequence=job);
INSERT INTO usage(hour, job, units, cpu_seconds)
  SELECT create_time_us / 3600000000, sequence, SUM(number), TOTAL(seconds)
  FROM jobs JOIN (
    SELECT job, 1 AS number, cpu_seconds AS seconds FROM units
    UNION ALL SELECT job, units, cpu_seconds FROM totals) ON job=sequence
  GROUP BY sequence;
CREATE TABLE events(  -- the newest
  sequence INTEGER PRIMARY KEY,
  time_us INTEGER NOT NULL,
  kind INTEGER NOT NULL,  -- EventKind in event_store.h
  job TEXT NOT NULL,
  owner TEXT NOT NULL,
  worker TEXT NOT NULL,
  text TEXT NOT NULL);
ALTER TABLE store ADD COLUMN dropped_event INTEGER NOT NULL DEFAULT 0;  -- up to which events are missing
UPDATE store SET dropped_event=(boot_count + 1) << 40;  -- sequences of earlier processes are below
)sql",
    R"sql(
CREATE TABLE past_usage(  -- of removed jobs whose rows are deleted
  hour INTEGER NOT NULL,
  owner TEXT NOT NULL,
  project TEXT NOT NULL,
  units INTEGER NOT NULL,
  cpu_seconds REAL NOT NULL,
  PRIMARY KEY (hour, owner, project)) WITHOUT ROWID;
CREATE VIEW accounts AS
  SELECT hour, owner, project, sequence, id, name, usage.units AS units,
    usage.cpu_seconds AS cpu_seconds FROM usage JOIN jobs ON job=sequence
  UNION ALL SELECT hour, owner, project, 0, '', '', units, cpu_seconds FROM past_usage;
CREATE INDEX removed_jobs ON jobs(sequence) WHERE removed=1;
)sql",
    R"sql(
ALTER TABLE jobs ADD COLUMN end_served_us INTEGER NOT NULL DEFAULT 0;  -- time of service at its end
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
    return absl::DataLossError("store.db is not a database of tessera-server");
  }
  if (version > kSchemaVersion) {
    return absl::FailedPreconditionError(
        absl::StrCat("the store has schema ", version,
                     ", written by a newer version; this version reads schema ", kSchemaVersion,
                     " and older: upgrade this program"));
  }
  return absl::OkStatus();
}

}  // namespace

std::int64_t schema_version() {
  return kSchemaVersion;
}

absl::Status check_schema(Database& database) {
  std::int64_t version = 0;
  if (absl::Status status = read_version(database, version); !status.ok()) return status;
  if (version == kSchemaVersion) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("the store has schema ", version, ", written by an older version; start this ",
                   "version's server on it once, which migrates it to schema ", kSchemaVersion));
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
