#include "server/store/maintenance/recover.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/digest.h"
#include "server/store/maintenance/table_salvage.h"
#include "server/store/sqlite/database.h"
#include "server/store/sqlite/schema.h"
#include "server/store/sqlite/store_id.h"

namespace tessera::server {
namespace {

/// Rows that are of no use without others that may be lost. Statements run in this order.
constexpr const char* kDropUseless[] = {
    "DELETE FROM units WHERE job NOT IN (SELECT sequence FROM jobs)",
    "DELETE FROM frames WHERE job NOT IN (SELECT sequence FROM jobs)",
    "DELETE FROM totals WHERE job NOT IN (SELECT sequence FROM jobs)",
    "DELETE FROM usage WHERE job NOT IN (SELECT sequence FROM jobs)",
    "DELETE FROM units WHERE segment=-1 AND offset NOT IN (SELECT id FROM blocks)",
    "DELETE FROM frames WHERE bytes=0 AND (job, frame) NOT IN (SELECT job, frame FROM images)",
    "DELETE FROM blocks WHERE id NOT IN (SELECT offset FROM units WHERE segment=-1)",
    "DELETE FROM images WHERE (job, frame) NOT IN (SELECT job, frame FROM frames WHERE bytes=0)",
    "DELETE FROM segments WHERE job NOT IN (SELECT sequence FROM jobs)",
    "DELETE FROM asset_contents WHERE sha256 NOT IN (SELECT sha256 FROM assets)",
};

/// Rows that follow from others. Units without a charge are charged in the hour of the job's
/// submission.
constexpr const char* kRestoreDerived = R"sql(
INSERT INTO segments(job, segment, bytes)
  SELECT job, segment, SUM(stored_bytes) FROM units WHERE segment>=0 GROUP BY job, segment
  ON CONFLICT(job, segment) DO UPDATE SET bytes=MAX(bytes, excluded.bytes);
WITH sums AS (
  SELECT job, 1 AS number, cpu_seconds AS seconds FROM units
  UNION ALL SELECT job, units, cpu_seconds FROM totals
  UNION ALL SELECT job, -units, -cpu_seconds FROM usage)
INSERT INTO usage(hour, job, units, cpu_seconds)
  SELECT create_time_us / 3600000000, sequence, SUM(number), MAX(TOTAL(seconds), 0.0)
  FROM sums JOIN main.jobs ON job=sequence GROUP BY sequence HAVING SUM(number)>0
  ON CONFLICT(hour, job) DO UPDATE SET units=units+excluded.units,
    cpu_seconds=cpu_seconds+excluded.cpu_seconds;
)sql";

/// Fills an empty database from a damaged one.
class Recoverer {
 public:
  Recoverer(Database& rows, std::string folder, Filesystem& filesystem)
      : rows_(rows), folder_(std::move(folder)), filesystem_(filesystem) {}

  absl::StatusOr<Recovery> run() {
    absl::Status status = migrate(rows_);
    if (status.ok()) status = attach(absl::StrCat(folder_, "/store.db"));
    // A failed read undoes its transaction, so each chunk of rows is one. All are synced at the
    // end.
    if (status.ok()) status = rows_.script("PRAGMA synchronous=OFF");
    if (status.ok()) status = copy_tables();
    if (status.ok()) status = drop_damaged();
    if (status.ok()) status = drop_useless();
    if (status.ok()) status = drop_missing_assets();
    if (status.ok()) status = rows_.script(kRestoreDerived);
    if (status.ok()) status = restore_store_row();
    if (!status.ok()) return status;
    status = rows_.script("DETACH damaged; PRAGMA synchronous=FULL");
    if (status.ok()) status = rows_.checkpoint();
    if (!status.ok()) return status;
    return std::move(recovery_);
  }

 private:
  absl::Status attach(const std::string& damaged) {
    absl::Status status = rows_.run("ATTACH ? AS damaged", {damaged});
    if (!status.ok()) return status;
    bool is_sound = false;
    status = rows_.each("PRAGMA damaged.integrity_check(1)", {},
                        [&](const SqlRow& row) { is_sound = row.bytes(0) == "ok"; });
    if (status.ok() && is_sound) {
      return absl::FailedPreconditionError(absl::StrCat(damaged, " is not damaged"));
    }
    std::int64_t tables = 0;
    return rows_.each("SELECT COUNT(*) FROM damaged.sqlite_schema", {},
                      [&](const SqlRow& row) { tables = row.integer(0); });
  }

  absl::Status copy_tables() {
    std::vector<std::string> tables;
    absl::Status status = rows_.each(
        "SELECT name FROM main.sqlite_schema WHERE type='table' AND name NOT LIKE 'sqlite_%'", {},
        [&](const SqlRow& row) { tables.push_back(row.text(0)); });
    if (!status.ok()) return status;
    for (const std::string& name : tables) {
      auto table = TableSalvage::create(rows_, name);
      if (!table.ok()) return table.status();
      if (absl::Status copied = table->run(); !copied.ok()) return copied;
      recovery_.tables.push_back({name, table->copied(), table->gaps()});
    }
    return absl::OkStatus();
  }

  absl::Status drop_useless() {
    for (const char* sql : kDropUseless) {
      if (absl::Status dropped = rows_.run(sql); !dropped.ok()) return dropped;
      recovery_.dropped_rows += rows_.changes();
    }
    return absl::OkStatus();
  }

  /// Drops images and scene files in rows that do not match their digests.
  absl::Status drop_damaged() {
    for (const auto& [select, remove] :
         {std::pair("SELECT images.rowid, image, file_sha256 FROM images JOIN frames "
                    "USING (job, frame)",
                    "DELETE FROM images WHERE rowid=?"),
          std::pair("SELECT rowid, contents, sha256 FROM asset_contents",
                    "DELETE FROM asset_contents WHERE rowid=?")}) {
      std::vector<std::int64_t> damaged;
      absl::Status status = rows_.each(select, {}, [&](const SqlRow& row) {
        if (contract::sha256(row.bytes(1)).binary() != row.bytes(2)) {
          damaged.push_back(row.integer(0));
        }
      });
      for (const std::int64_t row : damaged) status.Update(rows_.run(remove, {row}));
      if (!status.ok()) return status;
      recovery_.dropped_rows += static_cast<std::int64_t>(damaged.size());
    }
    return absl::OkStatus();
  }

  /// Drops scene files that have neither contents nor a file, so that clients upload them again.
  absl::Status drop_missing_assets() {
    std::vector<std::string> missing;
    absl::Status status = rows_.each(
        "SELECT sha256, lower(hex(sha256)) FROM assets "
        "WHERE sha256 NOT IN (SELECT sha256 FROM asset_contents)",
        {}, [&](const SqlRow& row) {
          const std::string hex = row.text(1);
          const std::string file = absl::StrCat(folder_, "/assets/", hex.substr(0, 2), "/",
                                                hex.substr(std::min<std::size_t>(2, hex.size())));
          if (!filesystem_.size_of(file).ok()) missing.push_back(row.text(0));
        });
    for (const std::string& sha256 : missing) {
      status.Update(rows_.run("DELETE FROM assets WHERE sha256=?", {Blob{sha256}}));
    }
    recovery_.dropped_rows += static_cast<std::int64_t>(missing.size());
    return status;
  }

  /// A store without its row gets a new ID and key, and a count above that of the events' server.
  /// If events are lost, consumers of those before the last one are told so.
  absl::Status restore_store_row() {
    const auto fresh = new_store_id();
    if (!fresh.ok()) return fresh.status();
    absl::Status status = rows_.run(
        "INSERT INTO store(one, id, key, boot_count) SELECT 1, ?, ?, "
        "COALESCE((SELECT MAX(sequence) FROM events) >> 40, 0) + 1 "
        "WHERE NOT EXISTS (SELECT 1 FROM store)",
        {fresh->id, Blob{fresh->key}});
    if (!status.ok() || gaps_of("events") == 0) return status;
    return rows_.run(
        "UPDATE store SET dropped_event=MAX(dropped_event, "
        "COALESCE((SELECT MAX(sequence) FROM events), (boot_count + 1) << 40))");
  }

  int gaps_of(const std::string& table) const {
    const auto found =
        std::find_if(recovery_.tables.begin(), recovery_.tables.end(),
                     [&](const Recovery::Table& known) { return known.name == table; });
    return found == recovery_.tables.end() ? 0 : found->gaps;
  }

  Database& rows_;
  const std::string folder_;
  Filesystem& filesystem_;
  Recovery recovery_;
};

/// Closes its database on return. `path`: of the new database.
absl::StatusOr<Recovery> recover_rows(const std::string& folder, const std::string& path,
                                      Filesystem& filesystem) {
  {
    const auto old = Database::open(folder + "/store.db", "", Database::Mode::reader);
    if (!old.ok()) return old.status();
    if (absl::Status known = check_schema(**old); !known.ok()) return known;
  }
  const auto rows = Database::open(path, "", Database::Mode::writer);
  if (!rows.ok()) return rows.status();
  return Recoverer(**rows, folder, filesystem).run();
}

}  // namespace

absl::StatusOr<Recovery> recover_store(const std::string& folder, Filesystem& filesystem) {
  const std::string path = absl::StrCat(folder, "/store.db");
  const std::string kept = path + ".damaged", part = path + ".part";
  if (const auto file = filesystem.open_existing(path); !file.ok()) {
    return absl::NotFoundError(absl::StrCat(folder, " is not a store: ", file.status().message()));
  }
  const auto lock = filesystem.lock(absl::StrCat(folder, "/lock"));
  if (!lock.ok()) return lock.status();
  if (filesystem.size_of(kept).ok()) {
    return absl::AlreadyExistsError(
        absl::StrCat(kept, " is left from an earlier recovery; move it away"));
  }
  absl::Status status;
  for (const char* suffix : {"", "-wal", "-shm"}) status.Update(filesystem.remove(part + suffix));
  if (!status.ok()) return status;
  auto recovery = recover_rows(folder, part, filesystem);
  if (!recovery.ok()) {
    for (const char* suffix : {"", "-wal", "-shm"}) (void)filesystem.remove(part + suffix);
    return recovery.status();
  }
  // SQLite would apply the log of the old database to the new one.
  if (filesystem.size_of(path + "-wal").value_or(0) > 0) {
    return absl::InternalError(absl::StrCat(path, "-wal: cannot be applied to its database"));
  }
  status = filesystem.link(path, kept);
  if (status.ok()) status = filesystem.rename(part, path);
  if (status.ok()) status = filesystem.sync_folder(folder);
  if (!status.ok()) return status;
  recovery->damaged = kept;
  return recovery;
}

}  // namespace tessera::server
