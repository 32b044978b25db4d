#include "server/store/maintenance/check.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/digest.h"
#include "server/store/files/durable_files.h"
#include "server/store/files/segments.h"
#include "server/store/sqlite/database.h"
#include "server/store/sqlite/schema.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kDone = 4;  // v1.Job.State

using SegmentKey = std::pair<std::string, std::int64_t>;  // job ID, number

absl::StatusOr<contract::Digest> digest_of(const File& file) {
  contract::Hasher hasher;
  std::vector<char> buffer(std::size_t{1} << 20);
  for (std::int64_t offset = 0; offset < file.size();) {
    const auto left = static_cast<std::size_t>(file.size() - offset);
    const std::span<char> part(buffer.data(), std::min(left, buffer.size()));
    if (absl::Status read = file.read_at(offset, part); !read.ok()) return read;
    hasher.update(std::string_view(part.data(), part.size()));
    offset += static_cast<std::int64_t>(part.size());
  }
  return hasher.finish();
}

/// Checks a store and adds to `findings`.
class Check {
 public:
  Check(std::string folder, Filesystem& filesystem, Database& rows)
      : folder_(std::move(folder)),
        filesystem_(filesystem),
        rows_(rows),
        files_(filesystem, [](const std::string&) { std::abort(); }),  // never syncs
        segments_(files_, absl::StrCat(folder_, "/segments"), 0) {}

  absl::StatusOr<StoreFindings> run() {
    for (const auto step :
         {&Check::look_at_database, &Check::look_at_jobs, &Check::look_at_units,
          &Check::look_at_totals, &Check::look_at_accounts, &Check::look_at_segments,
          &Check::look_at_frames, &Check::look_at_assets}) {
      if (absl::Status done = (this->*step)(); !done.ok()) return done;
    }
    return std::move(findings_);
  }

 private:
  struct JobRow {
    std::int64_t first_segment = 0;  // blocks in earlier segments are released
    std::string id;
    bool is_done = false;  // its units are replaced by totals
  };
  struct Extent {
    std::int64_t end = 0, bytes = 0;  // end of the last block; total size
  };

  template <typename... Parts>
  void fault(const Parts&... parts) {
    findings_.faults.push_back(absl::StrCat(parts...));
  }

  absl::Status look_at_database() {
    if (absl::Status known = check_schema(rows_); !known.ok()) return known;
    absl::Status status = rows_.each("PRAGMA integrity_check", {}, [&](const SqlRow& row) {
      if (row.bytes(0) != "ok") fault("store.db: ", row.text(0));
    });
    std::int64_t count = 0;
    status.Update(
        rows_.each("SELECT length(id), length(key) FROM store", {}, [&](const SqlRow& row) {
          ++count;
          if (row.integer(0) != 32 || row.integer(1) != 32) fault("store.db: ID or key damaged");
        }));
    if (count != 1) fault("store.db: table store has ", count, " rows instead of one");
    return status;
  }

  absl::Status look_at_jobs() {
    absl::Status status = rows_.each(
        "SELECT sequence, id, first_segment, state FROM jobs "
        "WHERE removed=0",
        {}, [&](const SqlRow& row) {
          jobs_[row.integer(0)] = {row.integer(2), row.text(1), row.integer(3) == kDone};
        });
    findings_.jobs = static_cast<std::int64_t>(jobs_.size());
    status.Update(rows_.each("SELECT job, frame FROM frames", {}, [&](const SqlRow& row) {
      finished_.emplace(row.integer(0), row.integer(1));
    }));
    return status;
  }

  absl::Status look_at_units() {
    return rows_.each(
        "SELECT job, frame, tile, pass, segment, offset, size_bytes, stored_bytes, sha256 "
        "FROM units ORDER BY job, segment, offset",
        {}, [&](const SqlRow& row) { look_at_unit(row); });
  }

  void look_at_unit(const SqlRow& row) {
    ++findings_.units;
    const std::string unit = absl::StrCat("job ", row.integer(0), ", unit (", row.integer(1), ", ",
                                          row.integer(2), ", ", row.integer(3), ")");
    const auto job = jobs_.find(row.integer(0));
    if (job == jobs_.end()) return fault(unit, ": no such job");
    if (job->second.is_done) return fault(unit, ": not in the totals of its finished job");
    const std::int64_t segment = row.integer(4), offset = row.integer(5), bytes = row.integer(7);
    if (segment < 0) return look_at_row_block(unit, offset, row.bytes(8));
    if (segment < job->second.first_segment) {
      if (finished_.count({row.integer(0), row.integer(1)}) > 0) return;
      return fault(unit, ": block released although its frame is not finished");
    }
    Extent& extent = extents_[{job->second.id, segment}];
    if (offset < extent.end) fault(unit, ": block overlaps another one");
    extent.end = std::max(extent.end, offset + bytes);
    extent.bytes += bytes;
    const auto block = segments_.read(job->second.id, {segment, offset}, bytes);
    if (!block.ok()) return fault(unit, ": ", block.status().message());
    ++findings_.blocks;
    if (contract::sha256(*block).binary() != row.bytes(8)) {
      fault(unit, ": digest mismatch");
    }
  }

  void look_at_row_block(const std::string& unit, std::int64_t id, std::string_view sha256) {
    std::optional<std::string> block;
    const absl::Status status = rows_.each("SELECT block FROM blocks WHERE id=?", {id},
                                           [&](const SqlRow& row) { block = row.text(0); });
    if (!status.ok() || !block) return fault(unit, ": its block is missing");
    ++findings_.blocks;
    if (contract::sha256(*block).binary() != sha256) fault(unit, ": digest mismatch");
  }

  absl::Status look_at_totals() {
    return rows_.each("SELECT job, worker, units, audited, cpu_seconds FROM totals", {},
                      [&](const SqlRow& row) {
                        findings_.units += row.integer(2);
                        const std::string totals = absl::StrCat("totals of worker ", row.text(1));
                        if (jobs_.count(row.integer(0)) == 0) {
                          return fault(totals, ": no job ", row.integer(0));
                        }
                        if (row.integer(2) < 1 || row.integer(3) < 0 ||
                            row.integer(3) > row.integer(2) || !(row.real(4) >= 0)) {
                          fault(totals, " of job ", jobs_.at(row.integer(0)).id, ": damaged");
                        }
                      });
  }

  /// Units that an extension has replaced stay charged.
  absl::Status look_at_accounts() {
    return rows_.each(
        "SELECT sequence, (SELECT TOTAL(units) FROM usage WHERE job=sequence) AS charged, "
        "(SELECT COUNT(*) FROM units WHERE job=sequence) + "
        "(SELECT TOTAL(units) FROM totals WHERE job=sequence) AS committed "
        "FROM jobs WHERE removed=0 AND charged<committed",
        {}, [&](const SqlRow& row) {
          fault("account of job ", jobs_.at(row.integer(0)).id, ": ", row.integer(1),
                " units are charged, ", row.integer(2), " are committed");
        });
  }

  absl::Status look_at_segments() {
    std::set<SegmentKey> known;
    absl::Status status =
        rows_.each("SELECT job, segment, bytes FROM segments", {}, [&](const SqlRow& row) {
          const auto job = jobs_.find(row.integer(0));
          if (job == jobs_.end()) {
            return fault("segment ", row.integer(1), ": no job ", row.integer(0));
          }
          const SegmentKey key(job->second.id, row.integer(1));
          known.insert(key);
          const auto extent = extents_.find(key);
          if (extent != extents_.end() && extent->second.bytes > row.integer(2)) {
            fault("segment ", key.second, " of job ", key.first, ": larger than its row says");
          }
        });
    for (const auto& [key, extent] : extents_) {
      if (known.count(key) == 0)
        fault("segment ", key.second, " of job ", key.first, ": has no row");
    }
    std::set<std::pair<std::string, std::string>> names;
    for (const auto& [job, number] : known) names.emplace(job, absl::StrCat(number, ".seg"));
    each_file("segments", [&](const std::string& job, const std::string& name) {
      return names.count({job, name}) > 0;
    });
    return status;
  }

  absl::Status look_at_frames() {
    std::set<std::pair<std::string, std::string>> known;
    absl::Status status = rows_.each(
        "SELECT job, frame, file, bytes, file_sha256 FROM frames", {}, [&](const SqlRow& row) {
          ++findings_.frames;
          const auto job = jobs_.find(row.integer(0));
          if (job == jobs_.end()) {
            return fault("frame ", row.integer(1), ": no job ", row.integer(0));
          }
          if (row.integer(3) == 0) return look_at_row_image(row);
          known.emplace(job->second.id, row.text(2));
          check_file(absl::StrCat("outputs/", job->second.id, "/", row.text(2)), row.integer(3),
                     row.bytes(4));
        });
    each_file("outputs", [&](const std::string& job, const std::string& name) {
      return known.count({job, name}) > 0;
    });
    return status;
  }

  /// `frame`: a row of look_at_frames() without a file.
  void look_at_row_image(const SqlRow& frame) {
    const std::string name =
        absl::StrCat("image of job ", frame.integer(0), ", frame ", frame.integer(1));
    std::optional<std::string> image;
    const absl::Status status = rows_.each("SELECT image FROM images WHERE job=? AND frame=?",
                                           {frame.integer(0), frame.integer(1)},
                                           [&](const SqlRow& row) { image = row.text(0); });
    if (!status.ok() || !image) return fault(name, ": missing");
    if (contract::sha256(*image).binary() != frame.bytes(4)) fault(name, ": digest mismatch");
  }

  absl::Status look_at_assets() {
    std::set<std::string> known;  // files
    absl::Status status = rows_.each(
        "SELECT lower(hex(sha256)), bytes, sha256, contents "
        "FROM assets LEFT JOIN asset_contents USING (sha256)",
        {}, [&](const SqlRow& row) {
          ++findings_.assets;
          const std::string hex = row.text(0);
          if (!row.is_null(3)) return look_at_row_asset(row);
          known.insert(hex);
          check_file(absl::StrCat("assets/", hex.substr(0, 2), "/",
                                  hex.substr(std::min<std::size_t>(2, hex.size()))),
                     row.integer(1), row.bytes(2));
        });
    status.Update(rows_.each(
        "SELECT lower(hex(sha256)) FROM asset_contents "
        "WHERE sha256 NOT IN (SELECT sha256 FROM assets)",
        {},
        [&](const SqlRow& row) { fault("contents of asset ", row.text(0), ": no such asset"); }));
    each_file("assets", [&](const std::string& folder, const std::string& name) {
      return known.count(folder + name) > 0;
    });
    return status;
  }

  /// `asset`: a row of look_at_assets() without a file.
  void look_at_row_asset(const SqlRow& asset) {
    const std::string name = absl::StrCat("asset ", asset.text(0));
    const std::string_view contents = asset.bytes(3);
    if (static_cast<std::int64_t>(contents.size()) != asset.integer(1)) {
      return fault(name, ": has ", contents.size(), " bytes, its row says ", asset.integer(1));
    }
    if (contract::sha256(contents).binary() != asset.bytes(2)) fault(name, ": digest mismatch");
  }

  void check_file(const std::string& name, std::int64_t bytes, std::string_view sha256) {
    const auto file = filesystem_.open_existing(absl::StrCat(folder_, "/", name));
    if (!file.ok()) return fault(name, ": ", file.status().message());
    if ((*file)->size() != bytes) {
      return fault(name, ": has ", (*file)->size(), " bytes, its row says ", bytes);
    }
    const auto digest = digest_of(**file);
    if (!digest.ok()) return fault(name, ": ", digest.status().message());
    if (digest->binary() != sha256) fault(name, ": digest mismatch");
  }

  /// Collects the files DIRECTORY/GROUP/NAME without a row.
  template <typename IsKnown>
  void each_file(const std::string& folder, const IsKnown& is_known) {
    const auto groups = filesystem_.list(absl::StrCat(folder_, "/", folder));
    if (!groups.ok()) return fault(folder, ": ", groups.status().message());
    for (const std::string& group : *groups) {
      const auto names = filesystem_.list(absl::StrCat(folder_, "/", folder, "/", group));
      if (!names.ok()) continue;  // a file, not a directory: not the store's
      for (const std::string& name : *names) {
        if (!is_known(group, name)) {
          findings_.orphans.push_back(absl::StrCat(folder, "/", group, "/", name));
        }
      }
    }
  }

  const std::string folder_;
  Filesystem& filesystem_;
  Database& rows_;
  DurableFiles files_;
  Segments segments_;
  StoreFindings findings_;
  std::map<std::int64_t, JobRow> jobs_;
  std::set<std::pair<std::int64_t, std::int64_t>> finished_;  // job, frame
  std::map<SegmentKey, Extent> extents_;
};

}  // namespace

absl::StatusOr<StoreFindings> check_store(const std::string& folder, Filesystem& filesystem) {
  const std::string path = absl::StrCat(folder, "/store.db");
  if (const auto file = filesystem.open_existing(path); !file.ok()) {
    return absl::NotFoundError(absl::StrCat(folder, " is not a store: ", file.status().message()));
  }
  const auto lock = filesystem.lock(absl::StrCat(folder, "/lock"));
  if (!lock.ok()) return lock.status();
  const auto rows = Database::open(path, filesystem.sqlite_vfs(), Database::Mode::reader);
  if (!rows.ok()) return rows.status();
  return Check(folder, filesystem, **rows).run();
}

}  // namespace tessera::server
