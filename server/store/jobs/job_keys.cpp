#include "server/store/jobs/job_keys.h"

#include "absl/strings/str_cat.h"

namespace tessera::server {

absl::StatusOr<JobKey> find_job(const Journal& journal, const std::string& job_id) {
  JobKey job;
  bool found = false;
  const absl::Status status = journal.read_as_writer([&](Database& rows) {
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

absl::Status no_such_job(const std::string& job_id) {
  return absl::NotFoundError(absl::StrCat("no job ", job_id, " in the store"));
}

absl::StatusOr<std::int64_t> sum_bytes(const Journal& journal, std::string_view sql,
                                       std::int64_t job) {
  std::int64_t sum = 0;
  absl::Status status = journal.read_as_writer([&](Database& rows) {
    return rows.each(sql, {job}, [&](const SqlRow& row) { sum = row.integer(0); });
  });
  if (!status.ok()) return status;
  return sum;
}

}  // namespace tessera::server
