#include "server/store/farm/usage_rows.h"

namespace tessera::server {

absl::StatusOr<std::vector<UsageSum>> UsageRows::read(const UsageQuery& query,
                                                      std::size_t limit) const {
  const UsageSum after = query.after.value_or(UsageSum{});
  std::vector<UsageSum> sums;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT CASE ?1 WHEN 1 THEN owner ELSE '' END AS by_owner, "
        "CASE ?2 WHEN 1 THEN project ELSE '' END AS by_project, "
        "CASE ?3 WHEN 1 THEN sequence ELSE 0 END AS by_job, "
        "CASE ?3 WHEN 1 THEN id ELSE '' END, CASE ?3 WHEN 1 THEN name ELSE '' END, "
        "SUM(units), TOTAL(cpu_seconds) FROM accounts "
        "WHERE hour>=?4 AND hour<?5 AND (?6=0 OR owner=?7) AND (?8=0 OR project=?9) "
        "GROUP BY by_owner, by_project, by_job "
        "HAVING ?10=0 OR (by_owner, by_project, by_job)>(?11, ?12, ?13) "
        "ORDER BY by_owner, by_project, by_job LIMIT ?14",
        {std::int64_t{query.by_owner}, std::int64_t{query.by_project}, std::int64_t{query.by_job},
         query.first_hour, query.end_hour, std::int64_t{query.owner.has_value()},
         query.owner ? std::string_view(*query.owner) : "", std::int64_t{query.project.has_value()},
         query.project ? std::string_view(*query.project) : "",
         std::int64_t{query.after.has_value()}, after.owner, after.project, after.job,
         static_cast<std::int64_t>(limit)},
        [&](const SqlRow& row) {
          sums.push_back({row.text(0), row.text(1), row.integer(2), row.text(3), row.text(4),
                          row.integer(5), row.real(6)});
        });
  });
  if (!status.ok()) return status;
  return sums;
}

absl::StatusOr<std::map<std::int64_t, UsageStore::Kept>> UsageRows::kept() const {
  std::map<std::int64_t, Kept> jobs;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT job, SUM(image_bytes), SUM(block_bytes) FROM ("
        "SELECT job, bytes AS image_bytes, 0 AS block_bytes FROM frames UNION ALL "
        "SELECT job, LENGTH(image), 0 FROM images UNION ALL "
        "SELECT job, 0, bytes FROM segments UNION ALL "
        "SELECT job, 0, LENGTH(block) FROM blocks) GROUP BY job",
        {}, [&](const SqlRow& row) {
          jobs[row.integer(0)] = {row.integer(1), row.integer(2)};
        });
  });
  if (!status.ok()) return status;
  return jobs;
}

absl::StatusOr<double> UsageRows::cpu_seconds(const UsageQuery& query) const {
  double sum = 0;
  absl::Status status = journal_.read_as_writer([&](Database& rows) {
    return rows.each(
        "SELECT TOTAL(cpu_seconds) FROM accounts "
        "WHERE hour>=?1 AND hour<?2 AND (?3=0 OR owner=?4) AND (?5=0 OR project=?6)",
        {query.first_hour, query.end_hour, std::int64_t{query.owner.has_value()},
         query.owner ? std::string_view(*query.owner) : "", std::int64_t{query.project.has_value()},
         query.project ? std::string_view(*query.project) : ""},
        [&](const SqlRow& row) { sum = row.real(0); });
  });
  if (!status.ok()) return status;
  return sum;
}

absl::Status UsageRows::charge(Database& rows, std::int64_t job, std::int64_t hour,
                               std::int64_t units, double cpu_seconds) {
  return rows.run(
      "INSERT INTO usage(hour, job, units, cpu_seconds) VALUES(?, ?, ?, ?) "
      "ON CONFLICT(hour, job) DO UPDATE SET units=units+excluded.units, "
      "cpu_seconds=cpu_seconds+excluded.cpu_seconds",
      {hour, job, units, cpu_seconds});
}

absl::Status UsageRows::refund(Database& rows, std::int64_t job,
                               const std::vector<contract::Unit>& units) {
  absl::Status status;
  for (const contract::Unit& unit : units) {
    std::int64_t hour = 0;
    double cpu_seconds = -1;  // the unit is not committed
    status.Update(rows.each(
        "SELECT hour, cpu_seconds FROM units WHERE job=? AND frame=? AND tile=? AND pass=?",
        {job, unit.frame, unit.tile, unit.pass}, [&](const SqlRow& row) {
          hour = row.integer(0);
          cpu_seconds = row.real(1);
        }));
    if (!status.ok() || cpu_seconds < 0) continue;
    // Sums in another order need not come to 0.
    status.Update(rows.run(
        "UPDATE usage SET units=units-1, cpu_seconds=MAX(cpu_seconds-?, 0) WHERE hour=? AND job=?",
        {cpu_seconds, hour, job}));
  }
  if (status.ok()) status = rows.run("DELETE FROM usage WHERE job=? AND units<=0", {job});
  return status;
}

}  // namespace tessera::server
