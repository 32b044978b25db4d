#include "server/store/jobs/unit_rows.h"

#include <optional>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/farm/usage_rows.h"
#include "server/store/sqlite/digests.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kInRow = -1;  // number of the segment of a block in the table blocks

absl::Status read_unit(const SqlRow& row, UnitRecord& record) {
  record.unit.frame = static_cast<std::int32_t>(row.integer(0));
  record.unit.tile = static_cast<std::int32_t>(row.integer(1));
  record.unit.pass = static_cast<std::int32_t>(row.integer(2));
  record.segment = row.integer(3);
  record.offset = row.integer(4);
  record.size_bytes = row.integer(5);
  record.stored_bytes = row.integer(6);
  record.worker_id = row.text(8);
  record.cpu_seconds = row.real(9);
  record.audit = static_cast<AuditState>(row.integer(10));
  return read_digest(row.bytes(7), record.sha256);
}

}  // namespace

UnitRows::UnitRows(DurableFiles& files, Journal& journal, std::string folder, Options options)
    : files_(files),
      journal_(journal),
      options_(std::move(options)),
      segments_(files_, std::move(folder), options_.segment_bytes) {}

absl::Status UnitRows::clean_up() {
  std::set<std::pair<std::string, std::int64_t>> known_segments;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each("SELECT id, segment, bytes FROM segments JOIN jobs ON job=sequence", {},
                     [&](const SqlRow& row) {
                       known_segments.emplace(row.text(0), row.integer(1));
                       file_bytes_ += row.integer(2);
                     });
  });
  if (!status.ok()) return status;
  return segments_.remove_orphans(
      [&](const std::string& job_id, std::int64_t segment) {
        return known_segments.count({job_id, segment}) != 0;
      },
      options_.warn);
}

absl::Status UnitRows::commit(std::vector<Commit>& group) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  if (group.empty()) return absl::OkStatus();
  std::map<std::string, std::vector<Commit*>> by_job;
  for (Commit& commit : group) by_job[commit.job_id].push_back(&commit);
  std::map<std::string, JobKey> jobs;
  for (const auto& [job_id, units] : by_job) {
    const auto job = find_job(journal_, job_id);
    if (!job.ok()) return job.status();
    jobs[job_id] = *job;
  }
  std::set<std::string> in_rows;
  for (auto& [job_id, units] : by_job) {
    if (fits_rows(job_id, units)) {
      in_rows.insert(job_id);
      continue;
    }
    absl::Status appended = append_job(job_id, jobs[job_id], units);
    if (!appended.ok()) return appended;
  }
  const std::int64_t hour = options_.now_us() / kHourUs;
  absl::Status status = journal_.write([&](Database& rows) {
    for (const auto& [job_id, units] : by_job) {
      absl::Status inserted;
      if (in_rows.count(job_id) > 0) inserted = insert_blocks(rows, jobs[job_id].sequence, units);
      if (inserted.ok()) inserted = insert_units(rows, jobs[job_id], hour, units);
      if (!inserted.ok()) return inserted;
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  std::int64_t added = 0;  // to segments
  for (const Commit& commit : group) {
    job_bytes_[commit.job_id] += commit.record.stored_bytes;
    if (commit.record.segment != kInRow) added += commit.record.stored_bytes;
  }
  journal_.after_write([this, added] { file_bytes_ += added; });
  return absl::OkStatus();
}

/// Whether these blocks are small, and the job with them. A job that has outgrown the rows does not
/// return to them in this process.
bool UnitRows::fits_rows(const std::string& job_id, const std::vector<Commit*>& units) const {
  const auto found = job_bytes_.find(job_id);
  std::int64_t sum = found == job_bytes_.end() ? 0 : found->second;
  for (const Commit* unit : units) {
    const auto bytes = static_cast<std::int64_t>(unit->block.size());
    if (bytes > options_.max_row_bytes) return false;
    sum += bytes;
  }
  return sum <= options_.max_job_row_bytes;
}

absl::Status UnitRows::append_job(const std::string& job_id, const JobKey& job,
                                  const std::vector<Commit*>& units) {
  std::vector<std::string_view> blocks;
  std::vector<SegmentPosition> positions(units.size());
  blocks.reserve(units.size());
  for (const Commit* unit : units) blocks.emplace_back(unit->block);
  absl::Status appended = segments_.append(job_id, job.next_segment, blocks, positions);
  if (!appended.ok()) return appended;
  for (std::size_t i = 0; i < units.size(); ++i) {
    UnitRecord& record = units[i]->record;
    record.segment = positions[i].segment;
    record.offset = positions[i].offset;
    record.size_bytes = static_cast<std::int64_t>(blocks[i].size());
    record.stored_bytes = record.size_bytes;
  }
  return absl::OkStatus();
}

absl::Status UnitRows::insert_blocks(Database& rows, std::int64_t job,
                                     const std::vector<Commit*>& units) {
  for (Commit* unit : units) {
    absl::Status inserted =
        rows.run("INSERT INTO blocks(job, block) VALUES(?, ?)", {job, Blob{unit->block}});
    if (!inserted.ok()) return inserted;
    UnitRecord& record = unit->record;
    record.segment = kInRow;
    record.offset = rows.last_row_id();
    record.size_bytes = record.stored_bytes = static_cast<std::int64_t>(unit->block.size());
  }
  return absl::OkStatus();
}

absl::Status UnitRows::insert_units(Database& rows, const JobKey& job, std::int64_t hour,
                                    const std::vector<Commit*>& units) {
  std::int64_t bytes = 0;
  double cpu_seconds = 0;
  for (const Commit* commit : units) {
    const UnitRecord& record = commit->record;
    bytes += record.stored_bytes;
    cpu_seconds += record.cpu_seconds;
    absl::Status inserted = rows.run(
        "INSERT INTO units(job, frame, tile, pass, segment, offset, size_bytes, stored_bytes, "
        "sha256, worker, cpu_seconds, audit, hour) VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        {job.sequence, record.unit.frame, record.unit.tile, record.unit.pass, record.segment,
         record.offset, record.size_bytes, record.stored_bytes, blob_of(record.sha256),
         record.worker_id, record.cpu_seconds, static_cast<std::int64_t>(record.audit), hour});
    if (absl::IsAlreadyExists(inserted)) {
      return absl::AlreadyExistsError(
          absl::StrCat("unit (", record.unit.frame, ", ", record.unit.tile, ", ", record.unit.pass,
                       ") of job ", commit->job_id, " is already committed"));
    }
    if (!inserted.ok()) return inserted;
  }
  absl::Status charged = UsageRows::charge(rows, job.sequence, hour,
                                           static_cast<std::int64_t>(units.size()), cpu_seconds);
  if (!charged.ok() || units.front()->record.segment == kInRow) return charged;
  return rows.run(
      "INSERT INTO segments(job, segment, bytes) VALUES(?1, ?2, ?3) "
      "ON CONFLICT(job, segment) DO UPDATE SET bytes=bytes+?3",
      {job.sequence, units.front()->record.segment, bytes});
}

absl::Status UnitRows::for_each(const std::string& job_id,
                                const std::function<void(const UnitRecord&)>& visit) const {
  absl::Status damage;
  const absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT frame, tile, pass, segment, offset, size_bytes, stored_bytes, sha256, worker, "
        "cpu_seconds, audit FROM units "
        "WHERE job=(SELECT sequence FROM jobs WHERE id=?) ORDER BY frame, tile, pass",
        {job_id}, [&](const SqlRow& row) {
          UnitRecord record;
          if (absl::Status read = read_unit(row, record); !read.ok()) {
            damage = read;
          } else {
            visit(record);
          }
        });
  });
  return status.ok() ? damage : status;
}

absl::StatusOr<std::string> UnitRows::read_block(const std::string& job_id,
                                                 const UnitRecord& record) const {
  auto block = record.segment == kInRow
                   ? read_row_block(record.offset)
                   : segments_.read(job_id, {record.segment, record.offset}, record.stored_bytes);
  const std::string unit =
      absl::StrCat("block of unit (", record.unit.frame, ", ", record.unit.tile, ", ",
                   record.unit.pass, ") of job ", job_id);
  if (block.ok() && contract::sha256(*block) == record.sha256) return block;
  if (block.ok()) {
    return absl::DataLossError(absl::StrCat(unit, ": digest mismatch"));
  }
  if (absl::IsOutOfRange(block.status())) {
    return absl::DataLossError(absl::StrCat(unit, ": ", std::string(block.status().message())));
  }
  if (!absl::IsNotFound(block.status()) || record.segment == kInRow) return block.status();
  bool wanted = false;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each("SELECT 1 FROM jobs WHERE id=? AND removed=0 AND first_segment<=?",
                     {job_id, record.segment}, [&](const SqlRow&) { wanted = true; });
  });
  if (!status.ok()) return status;
  if (wanted) return absl::DataLossError(absl::StrCat(unit, ": its segment is missing"));
  return absl::NotFoundError(absl::StrCat(unit, " was released"));
}

absl::StatusOr<std::string> UnitRows::read_row_block(std::int64_t id) const {
  std::optional<std::string> block;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each("SELECT block FROM blocks WHERE id=?", {id},
                     [&](const SqlRow& row) { block = row.text(0); });
  });
  if (!status.ok()) return status;
  if (!block) return absl::NotFoundError("the block was released");
  return *std::move(block);
}

absl::Status UnitRows::drop(const std::string& job_id, const std::vector<contract::Unit>& units) {
  const auto job = find_job(journal_, job_id);
  if (!job.ok()) return job.status();
  return journal_.write([&](Database& rows) {
    absl::Status refunded = UsageRows::refund(rows, job->sequence, units);
    return refunded.ok() ? delete_units(rows, job->sequence, units) : refunded;
  });
}

absl::Status UnitRows::delete_units(Database& rows, std::int64_t job,
                                    const std::vector<contract::Unit>& units) {
  for (const contract::Unit& unit : units) {
    absl::Status dropped =
        rows.run("DELETE FROM units WHERE job=? AND frame=? AND tile=? AND pass=?",
                 {job, unit.frame, unit.tile, unit.pass});
    if (!dropped.ok()) return dropped;
  }
  return absl::OkStatus();
}

absl::Status UnitRows::set_audits(const std::string& job_id,
                                  const std::vector<contract::Unit>& units, AuditState state) {
  const auto job = find_job(journal_, job_id);
  if (!job.ok()) return job.status();
  return journal_.write([&](Database& rows) {
    for (const contract::Unit& unit : units) {
      absl::Status set = rows.run(
          "UPDATE units SET audit=? WHERE job=? AND frame=? AND tile=? AND pass=?",
          {static_cast<std::int64_t>(state), job->sequence, unit.frame, unit.tile, unit.pass});
      if (!set.ok()) return set;
    }
    return absl::OkStatus();
  });
}

absl::Status UnitRows::close_job(const std::string& job_id) {
  const auto job = find_job(journal_, job_id);
  if (!job.ok()) return job.status();
  const auto freed = file_bytes_of(job->sequence);
  if (!freed.ok()) return freed.status();
  absl::Status status = journal_.write([&](Database& rows) {
    absl::Status added = add_up_units(rows, job->sequence);
    if (!added.ok()) return added;
    absl::Status moved = rows.run("UPDATE jobs SET first_segment=? WHERE sequence=?",
                                  {job->next_segment, job->sequence});
    if (!moved.ok()) return moved;
    moved = rows.run("DELETE FROM blocks WHERE job=?", {job->sequence});
    if (!moved.ok()) return moved;
    return rows.run("DELETE FROM segments WHERE job=?", {job->sequence});
  });
  if (!status.ok()) return status;
  journal_.after_write([this, job_id, bytes = *freed, end = job->next_segment] {
    job_bytes_.erase(job_id);
    file_bytes_ -= bytes;
    files_.note_deletion(segments_.release(job_id, end));
  });
  return absl::OkStatus();
}

absl::Status UnitRows::add_up_units(Database& rows, std::int64_t job) {
  absl::Status added = rows.run(
      "INSERT INTO totals(job, worker, units, cpu_seconds, audited) "
      "SELECT job, worker, COUNT(*), TOTAL(cpu_seconds), COUNT(*) FILTER (WHERE audit=?2) "
      "FROM units WHERE job=?1 GROUP BY worker "
      "ON CONFLICT(job, worker) DO UPDATE SET units=units+excluded.units, "
      "cpu_seconds=cpu_seconds+excluded.cpu_seconds, audited=audited+excluded.audited",
      {job, static_cast<std::int64_t>(AuditState::ended)});
  return added.ok() ? rows.run("DELETE FROM units WHERE job=?", {job}) : added;
}

absl::StatusOr<std::vector<UnitTotals>> UnitRows::totals(const std::string& job_id) const {
  std::vector<UnitTotals> totals;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT worker, units, audited, cpu_seconds FROM totals "
        "WHERE job=(SELECT sequence FROM jobs WHERE id=?) ORDER BY worker",
        {job_id}, [&](const SqlRow& row) {
          totals.push_back({row.text(0), row.integer(1), row.integer(2), row.real(3)});
        });
  });
  if (!status.ok()) return status;
  return totals;
}

absl::StatusOr<std::int64_t> UnitRows::file_bytes_of(std::int64_t job) const {
  return sum_bytes(journal_, "SELECT TOTAL(bytes) FROM segments WHERE job=?", job);
}

void UnitRows::remove_files(const std::string& job_id, std::int64_t bytes) {
  job_bytes_.erase(job_id);
  file_bytes_ -= bytes;
  files_.note_deletion(segments_.remove_job(job_id));
}

}  // namespace tessera::server
