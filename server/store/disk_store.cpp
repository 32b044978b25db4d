#include "server/store/disk_store.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/files/names.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kInRow = -1;  // number of the segment of a block in the table blocks

absl::Status read_digest(std::string_view bytes, contract::Digest& digest) {
  const auto read = contract::Digest::from_binary(bytes);
  if (!read.has_value()) return absl::DataLossError("a digest in store.db is damaged");
  digest = *read;
  return absl::OkStatus();
}

absl::Status no_such_job(const std::string& job_id) {
  return absl::NotFoundError(absl::StrCat("no job ", job_id, " in the store"));
}

/// Returns a request ID, or NULL if it is empty: NULLs never conflict.
SqlValue optional_text(const std::string& text) {
  if (text.empty()) return std::monostate();
  return std::string_view(text);
}

JobRecord read_job(const SqlRow& row) {
  JobRecord job;
  job.sequence = row.integer(0);
  job.id = row.text(1);
  job.request_id = row.text(2);
  job.name = row.text(3);
  job.owner = row.text(4);
  job.request = row.text(5);
  job.state = static_cast<std::int32_t>(row.integer(6));
  job.reason = row.text(7);
  job.create_time_us = row.integer(8);
  job.end_time_us = row.integer(9);
  job.wall_seconds = row.real(10);
  job.render_contract = static_cast<std::int32_t>(row.integer(11));
  job.failure_code = static_cast<std::int32_t>(row.integer(12));
  job.project = row.text(13);
  job.failed_attempts = row.text(14);
  return job;
}

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

absl::Status DiskStore::write_together(const std::function<void()>& body) {
  at_any_cost_ = false;
  absl::Status status = journal_->write_together(body);
  if (absl::IsResourceExhausted(status) && at_any_cost_ && ballast_.give_up()) {
    status = journal_->write_together(body);
  }
  return status;
}

absl::Status DiskStore::add_job(JobRecord& job) {
  if (!is_plain_name(job.id)) {
    return absl::InvalidArgumentError(absl::StrCat("\"", job.id, "\" is not a valid job ID"));
  }
  return journal_->write([&](Database& rows) {
    absl::Status added = rows.run(
        "INSERT INTO jobs(id, request_id, name, owner, request, state, reason, create_time_us, "
        "end_time_us, wall_seconds, render_contract, failure_code, project, failed_attempts) "
        "VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        {job.id, optional_text(job.request_id), job.name, job.owner, Blob{job.request}, job.state,
         job.reason, job.create_time_us, job.end_time_us, job.wall_seconds, job.render_contract,
         job.failure_code, job.project, job.failed_attempts});
    if (absl::IsAlreadyExists(added)) {
      return absl::AlreadyExistsError(
          absl::StrCat("job ", job.id, " or its request ", job.request_id, " is already in use"));
    }
    if (added.ok()) job.sequence = rows.last_row_id();
    return added;
  });
}

absl::Status DiskStore::write_at_any_cost(const std::function<absl::Status(Database&)>& body) {
  at_any_cost_ = true;
  absl::Status status = journal_->write(body);
  if (absl::IsResourceExhausted(status) && ballast_.give_up()) status = journal_->write(body);
  return status;
}

absl::Status DiskStore::update_job(const JobRecord& job) {
  const auto update = [&](Database& rows) { return update_row(rows, job); };
  // Only jobs that have ended can be removed.
  return job.end_time_us != 0 ? write_at_any_cost(update) : journal_->write(update);
}

absl::Status DiskStore::update_row(Database& rows, const JobRecord& job) {
  const absl::Status updated = rows.run(
      "UPDATE jobs SET name=?, owner=?, request=?, state=?, reason=?, create_time_us=?, "
      "end_time_us=?, wall_seconds=?, render_contract=?, failure_code=?, failed_attempts=? "
      "WHERE id=? AND removed=0",
      {job.name, job.owner, Blob{job.request}, job.state, job.reason, job.create_time_us,
       job.end_time_us, job.wall_seconds, job.render_contract, job.failure_code,
       job.failed_attempts, job.id});
  return updated.ok() && rows.changes() == 0 ? no_such_job(job.id) : updated;
}

absl::Status DiskStore::rewrite_job(const JobRecord& job,
                                    const std::vector<contract::Unit>& dropped) {
  const auto row = find_job(job.id);
  if (!row.ok()) return row.status();
  return journal_->write([&](Database& rows) {
    absl::Status status = delete_units(rows, row->sequence, dropped);
    return status.ok() ? update_row(rows, job) : status;
  });
}

absl::Status DiskStore::remove_job(const std::string& job_id) {
  const auto job = find_job(job_id);
  if (!job.ok()) return job.status();
  const auto freed = sum_bytes(
      "SELECT (SELECT TOTAL(bytes) FROM segments WHERE job=?1) + "
      "(SELECT TOTAL(bytes) FROM frames WHERE job=?1)",
      job->sequence);
  if (!freed.ok()) return freed.status();
  absl::Status status = write_at_any_cost([&](Database& rows) {
    for (const std::string_view sql :
         {"DELETE FROM units WHERE job=?", "DELETE FROM totals WHERE job=?",
          "DELETE FROM segments WHERE job=?", "DELETE FROM blocks WHERE job=?",
          "DELETE FROM frames WHERE job=?", "DELETE FROM images WHERE job=?",
          "UPDATE jobs SET removed=1,request='',reason='',failed_attempts='' WHERE sequence=?"}) {
      if (absl::Status gone = rows.run(sql, {job->sequence}); !gone.ok()) return gone;
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return journal_->after_write([this, job_id, bytes = *freed] {
    job_bytes_.erase(job_id);
    content_bytes_ -= bytes;
    absl::Status removed = segments_.remove_job(job_id);
    removed.Update(files_.remove_folder(absl::StrCat(folder_, "/outputs/", job_id)));
    set_up_ballast();
    return removed;
  });
}

absl::StatusOr<std::vector<JobRecord>> DiskStore::jobs() const {
  std::vector<JobRecord> jobs;
  absl::Status status = journal_->read([&](Database& rows) {
    return rows.each(
        "SELECT sequence, id, request_id, name, owner, request, state, reason, create_time_us, "
        "end_time_us, wall_seconds, render_contract, failure_code, project, failed_attempts "
        "FROM jobs WHERE removed=0 ORDER BY sequence",
        {}, [&](const SqlRow& row) { jobs.push_back(read_job(row)); });
  });
  if (!status.ok()) return status;
  return jobs;
}

absl::StatusOr<std::optional<std::int32_t>> DiskStore::removed_state(
    const std::string& job_id) const {
  std::optional<std::int32_t> state;
  absl::Status status = journal_->read([&](Database& rows) {
    return rows.each("SELECT state FROM jobs WHERE removed=1 AND id=?", {job_id},
                     [&](const SqlRow& row) { state = static_cast<std::int32_t>(row.integer(0)); });
  });
  if (!status.ok()) return status;
  return state;
}

absl::Status DiskStore::commit(std::vector<Commit>& group) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  if (group.empty()) return absl::OkStatus();
  std::map<std::string, std::vector<Commit*>> by_job;
  for (Commit& commit : group) by_job[commit.job_id].push_back(&commit);
  std::map<std::string, JobRow> jobs;
  for (const auto& [job_id, units] : by_job) {
    const auto job = find_job(job_id);
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
  absl::Status status = journal_->write([&](Database& rows) {
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
  return journal_->after_write([this, added] {
    content_bytes_ += added;
    return absl::OkStatus();
  });
}

/// Whether these blocks are small, and the job with them. A job that has outgrown the rows does not
/// return to them in this process.
bool DiskStore::fits_rows(const std::string& job_id, const std::vector<Commit*>& units) const {
  const auto found = job_bytes_.find(job_id);
  std::int64_t sum = found == job_bytes_.end() ? 0 : found->second;
  for (const Commit* unit : units) {
    const auto bytes = static_cast<std::int64_t>(unit->block.size());
    if (bytes > options_.row_block_bytes) return false;
    sum += bytes;
  }
  return sum <= options_.row_blocks_per_job_bytes;
}

absl::Status DiskStore::append_job(const std::string& job_id, const JobRow& job,
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

absl::Status DiskStore::insert_blocks(Database& rows, std::int64_t job,
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

absl::Status DiskStore::insert_units(Database& rows, const JobRow& job, std::int64_t hour,
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

absl::Status DiskStore::for_each_unit(const std::string& job_id,
                                      const std::function<void(const UnitRecord&)>& visit) const {
  absl::Status damage;
  const absl::Status status = journal_->read([&](Database& rows) {
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

absl::StatusOr<std::string> DiskStore::read_block(const std::string& job_id,
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
  absl::Status status = journal_->read([&](Database& rows) {
    return rows.each("SELECT 1 FROM jobs WHERE id=? AND removed=0 AND first_segment<=?",
                     {job_id, record.segment}, [&](const SqlRow&) { wanted = true; });
  });
  if (!status.ok()) return status;
  if (wanted) return absl::DataLossError(absl::StrCat(unit, ": its segment is missing"));
  return absl::NotFoundError(absl::StrCat(unit, " was released"));
}

absl::StatusOr<std::string> DiskStore::read_row_block(std::int64_t id) const {
  std::optional<std::string> block;
  absl::Status status = journal_->read([&](Database& rows) {
    return rows.each("SELECT block FROM blocks WHERE id=?", {id},
                     [&](const SqlRow& row) { block = row.text(0); });
  });
  if (!status.ok()) return status;
  if (!block) return absl::NotFoundError("the block was released");
  return *std::move(block);
}

absl::Status DiskStore::drop_units(const std::string& job_id,
                                   const std::vector<contract::Unit>& units) {
  const auto job = find_job(job_id);
  if (!job.ok()) return job.status();
  return journal_->write([&](Database& rows) {
    absl::Status refunded = UsageRows::refund(rows, job->sequence, units);
    return refunded.ok() ? delete_units(rows, job->sequence, units) : refunded;
  });
}

/// Their bytes stay in the segments or rows, and in the size, until those are released.
absl::Status DiskStore::delete_units(Database& rows, std::int64_t job,
                                     const std::vector<contract::Unit>& units) {
  for (const contract::Unit& unit : units) {
    absl::Status dropped =
        rows.run("DELETE FROM units WHERE job=? AND frame=? AND tile=? AND pass=?",
                 {job, unit.frame, unit.tile, unit.pass});
    if (!dropped.ok()) return dropped;
  }
  return absl::OkStatus();
}

absl::Status DiskStore::end_audits(const std::string& job_id,
                                   const std::vector<contract::Unit>& units) {
  const auto job = find_job(job_id);
  if (!job.ok()) return job.status();
  return journal_->write([&](Database& rows) {
    for (const contract::Unit& unit : units) {
      absl::Status ended =
          rows.run("UPDATE units SET audit=? WHERE job=? AND frame=? AND tile=? AND pass=?",
                   {static_cast<std::int64_t>(AuditState::ended), job->sequence, unit.frame,
                    unit.tile, unit.pass});
      if (!ended.ok()) return ended;
    }
    return absl::OkStatus();
  });
}

absl::StatusOr<std::vector<FrameRecord>> DiskStore::frames(const std::string& job_id) const {
  std::vector<FrameRecord> frames;
  absl::Status damage;
  const absl::Status status = journal_->read([&](Database& rows) {
    return rows.each(
        "SELECT frame, file, file_sha256, pixels_sha256, statistics_json FROM frames "
        "WHERE job=(SELECT sequence FROM jobs WHERE id=?) ORDER BY frame",
        {job_id}, [&](const SqlRow& row) {
          FrameRecord& frame = frames.emplace_back();
          frame.frame = static_cast<std::int32_t>(row.integer(0));
          frame.file = row.text(1);
          damage.Update(read_digest(row.bytes(2), frame.file_sha256));
          damage.Update(read_digest(row.bytes(3), frame.pixels_sha256));
          frame.statistics_json = row.text(4);
        });
  });
  if (!status.ok()) return status;
  if (!damage.ok()) return damage;
  return frames;
}

absl::Status DiskStore::close_job(const std::string& job_id) {
  const auto job = find_job(job_id);
  if (!job.ok()) return job.status();
  const auto freed = sum_bytes("SELECT TOTAL(bytes) FROM segments WHERE job=?", job->sequence);
  if (!freed.ok()) return freed.status();
  absl::Status status = journal_->write([&](Database& rows) {
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
  return journal_->after_write([this, job_id, bytes = *freed, end = job->next_segment] {
    job_bytes_.erase(job_id);
    content_bytes_ -= bytes;
    return segments_.release(job_id, end);
  });
}

absl::Status DiskStore::add_up_units(Database& rows, std::int64_t job) {
  absl::Status added = rows.run(
      "INSERT INTO totals(job, worker, units, cpu_seconds, audited) "
      "SELECT job, worker, COUNT(*), TOTAL(cpu_seconds), COUNT(*) FILTER (WHERE audit=?2) "
      "FROM units WHERE job=?1 GROUP BY worker "
      "ON CONFLICT(job, worker) DO UPDATE SET units=units+excluded.units, "
      "cpu_seconds=cpu_seconds+excluded.cpu_seconds, audited=audited+excluded.audited",
      {job, static_cast<std::int64_t>(AuditState::ended)});
  return added.ok() ? rows.run("DELETE FROM units WHERE job=?", {job}) : added;
}

absl::StatusOr<std::vector<UnitTotals>> DiskStore::totals(const std::string& job_id) const {
  std::vector<UnitTotals> totals;
  absl::Status status = journal_->read([&](Database& rows) {
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

std::int64_t DiskStore::free_bytes() const {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(folder_, error);
  return error ? 0 : static_cast<std::int64_t>(space.available);
}

std::int64_t DiskStore::used_bytes() const {
  return content_bytes_ + assets_->file_bytes() + journal_->used_bytes();
}

absl::StatusOr<DiskStore::JobRow> DiskStore::find_job(const std::string& job_id) const {
  JobRow job;
  bool found = false;
  const absl::Status status = journal_->read_as_writer([&](Database& rows) {
    return rows.each(
        "SELECT sequence, MAX(first_segment, "
        "IFNULL((SELECT MAX(segment) + 1 FROM segments WHERE job=sequence), 0)) "
        "FROM jobs WHERE id=? AND removed=0",
        {job_id}, [&](const SqlRow& row) {
          found = true;
          job = {row.integer(0), row.integer(1)};
        });
  });
  if (!status.ok()) return status;
  if (!found) return no_such_job(job_id);
  return job;
}

absl::StatusOr<std::int64_t> DiskStore::sum_bytes(std::string_view sql, std::int64_t job) const {
  std::int64_t sum = 0;
  absl::Status status = journal_->read_as_writer([&](Database& rows) {
    return rows.each(sql, {job}, [&](const SqlRow& row) { sum = row.integer(0); });
  });
  if (!status.ok()) return status;
  return sum;
}

}  // namespace tessera::server
