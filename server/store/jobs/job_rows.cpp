#include "server/store/jobs/job_rows.h"

#include <algorithm>
#include <string_view>
#include <utility>
#include <variant>

#include "absl/strings/str_cat.h"
#include "server/store/files/names.h"
#include "server/store/jobs/job_keys.h"

namespace tessera::server {
namespace {

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
  job.end_served_us = row.integer(15);
  return job;
}

}  // namespace

absl::Status JobRows::count_removed() {
  return journal_.read_as_writer([&](Database& rows) {
    return rows.each("SELECT COUNT(*) FROM jobs WHERE removed=1", {},
                     [&](const SqlRow& row) { removed_count_ = row.integer(0); });
  });
}

absl::Status JobRows::add(JobRecord& job) {
  if (!is_plain_name(job.id)) {
    return absl::InvalidArgumentError(absl::StrCat("\"", job.id, "\" is not a valid job ID"));
  }
  return journal_.write([&](Database& rows) {
    absl::Status added = rows.run(
        "INSERT INTO jobs(id, request_id, name, owner, request, state, reason, create_time_us, "
        "end_time_us, wall_seconds, render_contract, failure_code, project, failed_attempts, "
        "end_served_us) VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        {job.id, optional_text(job.request_id), job.name, job.owner, Blob{job.request}, job.state,
         job.reason, job.create_time_us, job.end_time_us, job.wall_seconds, job.render_contract,
         job.failure_code, job.project, job.failed_attempts, job.end_served_us});
    if (absl::IsAlreadyExists(added)) {
      return absl::AlreadyExistsError(
          absl::StrCat("job ", job.id, " or its request ", job.request_id, " is already in use"));
    }
    if (added.ok()) job.sequence = rows.last_row_id();
    return added;
  });
}

absl::Status JobRows::update(const JobRecord& job) {
  const auto update = [&](Database& rows) { return update_row(rows, job); };
  // Only jobs that have ended can be removed.
  return job.end_time_us != 0 ? reserve_.write_at_any_cost(journal_, update)
                              : journal_.write(update);
}

absl::Status JobRows::update_row(Database& rows, const JobRecord& job) {
  const absl::Status updated = rows.run(
      "UPDATE jobs SET name=?, owner=?, request=?, state=?, reason=?, create_time_us=?, "
      "end_time_us=?, wall_seconds=?, render_contract=?, failure_code=?, failed_attempts=?, "
      "end_served_us=? WHERE id=? AND removed=0",
      {job.name, job.owner, Blob{job.request}, job.state, job.reason, job.create_time_us,
       job.end_time_us, job.wall_seconds, job.render_contract, job.failure_code,
       job.failed_attempts, job.end_served_us, job.id});
  return updated.ok() && rows.changes() == 0 ? no_such_job(job.id) : updated;
}

absl::Status JobRows::rewrite(const JobRecord& job, const std::vector<contract::Unit>& dropped) {
  const auto row = find_job(journal_, job.id);
  if (!row.ok()) return row.status();
  return journal_.write([&](Database& rows) {
    absl::Status status = UnitRows::delete_units(rows, row->sequence, dropped);
    return status.ok() ? update_row(rows, job) : status;
  });
}

absl::Status JobRows::remove(const std::string& job_id) {
  const auto job = find_job(journal_, job_id);
  if (!job.ok()) return job.status();
  const auto unit_bytes = units_.file_bytes_of(job->sequence);
  if (!unit_bytes.ok()) return unit_bytes.status();
  const auto frame_bytes = frames_.file_bytes_of(job->sequence);
  if (!frame_bytes.ok()) return frame_bytes.status();
  absl::Status status = reserve_.write_at_any_cost(journal_, [&](Database& rows) {
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
  ++removed_count_;
  drop_old_rows().IgnoreError();  // on a full disk, a later removal does it
  journal_.after_write([this, job_id, units = *unit_bytes, frames = *frame_bytes] {
    units_.remove_files(job_id, units);
    frames_.remove_files(job_id, frames);
    reserve_.set_up();
  });
  return absl::OkStatus();
}

/// Deletes the rows of the jobs that were submitted first of those that are removed, once there are
/// many more than are kept. Their usage stays, without the jobs.
absl::Status JobRows::drop_old_rows() {
  const std::int64_t most = max_removed_ + std::max<std::int64_t>(max_removed_ / 20, 1);
  if (removed_count_ < most) return absl::OkStatus();
  // Counted again, because removals may have failed since.
  if (absl::Status counted = count_removed(); !counted.ok()) return counted;
  if (removed_count_ < most) return absl::OkStatus();
  const std::int64_t excess = removed_count_ - max_removed_;
  absl::Status status = journal_.write([&](Database& rows) {
    std::int64_t last = 0;
    absl::Status dropped =
        rows.each("SELECT sequence FROM jobs WHERE removed=1 ORDER BY sequence LIMIT 1 OFFSET ?",
                  {excess - 1}, [&](const SqlRow& row) { last = row.integer(0); });
    for (const std::string_view sql :
         {"INSERT INTO past_usage(hour, owner, project, units, cpu_seconds) "
          "SELECT hour, owner, project, SUM(units), TOTAL(cpu_seconds) "
          "FROM usage JOIN jobs ON job=sequence WHERE removed=1 AND sequence<=? "
          "GROUP BY hour, owner, project "
          "ON CONFLICT(hour, owner, project) DO UPDATE SET units=units+excluded.units, "
          "cpu_seconds=cpu_seconds+excluded.cpu_seconds",
          "DELETE FROM usage WHERE job IN "
          "(SELECT sequence FROM jobs WHERE removed=1 AND sequence<=?)",
          "DELETE FROM jobs WHERE removed=1 AND sequence<=?"}) {
      if (dropped.ok()) dropped = rows.run(sql, {last});
    }
    return dropped;
  });
  if (status.ok()) removed_count_ -= excess;
  return status;
}

absl::StatusOr<std::vector<JobRecord>> JobRows::list() const {
  std::vector<JobRecord> jobs;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT sequence, id, request_id, name, owner, request, state, reason, create_time_us, "
        "end_time_us, wall_seconds, render_contract, failure_code, project, failed_attempts, "
        "end_served_us "
        "FROM jobs WHERE removed=0 ORDER BY sequence",
        {}, [&](const SqlRow& row) { jobs.push_back(read_job(row)); });
  });
  if (!status.ok()) return status;
  return jobs;
}

absl::StatusOr<std::optional<std::int32_t>> JobRows::removed_state(
    const std::string& job_id) const {
  std::optional<std::int32_t> state = 0;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each("SELECT removed, state FROM jobs WHERE id=?", {job_id},
                     [&](const SqlRow& row) {
                       state.reset();
                       if (row.integer(0) == 1) state = static_cast<std::int32_t>(row.integer(1));
                     });
  });
  if (!status.ok()) return status;
  return state;
}

}  // namespace tessera::server
