#include "server/store/farm/worker_rows.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

absl::Status note_seen(Database& rows, const std::string& worker_id, std::int64_t now_us) {
  return rows.run("UPDATE joins SET seen_us=? WHERE worker=?", {now_us, worker_id});
}

}  // namespace

absl::Status WorkerRows::add_worker(const std::string& worker_id, const std::string& name) {
  const std::int64_t now = now_us_();
  return journal_.write([&](Database& rows) {
    absl::Status seen = note_seen(rows, worker_id, now);
    if (!seen.ok()) return seen;
    return rows.run("INSERT OR REPLACE INTO workers(id, name) VALUES(?, ?)", {worker_id, name});
  });
}

absl::Status WorkerRows::remove_worker(const std::string& worker_id) {
  const std::int64_t now = now_us_();
  return journal_.write([&](Database& rows) {
    absl::Status seen = note_seen(rows, worker_id, now);
    return seen.ok() ? rows.run("DELETE FROM workers WHERE id=?", {worker_id}) : seen;
  });
}

absl::StatusOr<std::vector<std::string>> WorkerRows::roster() const {
  return read_ids("SELECT id FROM workers ORDER BY id");
}

absl::Status WorkerRows::ban_worker(const std::string& worker_id) {
  return journal_.write([&](Database& rows) {
    return rows.run("INSERT OR REPLACE INTO bans(worker) VALUES(?)", {worker_id});
  });
}

absl::Status WorkerRows::allow_worker(const std::string& worker_id) {
  return journal_.write(
      [&](Database& rows) { return rows.run("DELETE FROM bans WHERE worker=?", {worker_id}); });
}

absl::StatusOr<std::vector<std::string>> WorkerRows::banned_workers() const {
  return read_ids("SELECT worker FROM bans ORDER BY worker");
}

absl::StatusOr<std::vector<std::string>> WorkerRows::read_ids(std::string_view sql) const {
  std::vector<std::string> ids;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(sql, {}, [&](const SqlRow& row) { ids.push_back(row.text(0)); });
  });
  if (!status.ok()) return status;
  return ids;
}

absl::Status WorkerRows::record_join(const Join& join, std::int64_t max_joins) {
  const std::int64_t now = now_us_();
  return journal_.write([&](Database& rows) {
    bool is_known = false, is_taken = false;
    absl::Status status = rows.each("SELECT token, certificate FROM joins WHERE worker=?",
                                    {join.worker_id}, [&](const SqlRow& row) {
                                      is_known = is_known || row.bytes(0) == join.token_id;
                                      is_taken = is_taken || row.bytes(1) != join.certificate;
                                    });
    if (!status.ok()) return status;
    if (is_taken) {
      return absl::PermissionDeniedError(
          absl::StrCat("worker ID ", join.worker_id, " belongs to another certificate"));
    }
    if (is_known) return absl::OkStatus();
    std::int64_t count = 0;
    status = rows.each("SELECT COUNT(*) FROM joins WHERE token=?", {join.token_id},
                       [&](const SqlRow& row) { count = row.integer(0); });
    if (!status.ok()) return status;
    if (max_joins > 0 && count >= max_joins) {
      return absl::PermissionDeniedError(
          absl::StrCat("join token ", join.token_id, " is used up by ", count, " workers"));
    }
    return rows.run("INSERT INTO joins(worker, token, certificate, seen_us) VALUES(?, ?, ?, ?)",
                    {join.worker_id, join.token_id, join.certificate, now});
  });
}

absl::Status WorkerRows::remove_stale_joins(const std::vector<std::string>& valid,
                                            std::int64_t unseen_since_us) {
  return journal_.write([&](Database& rows) {
    std::vector<std::pair<std::string, std::string>> gone;  // worker, token
    absl::Status status = rows.each(
        "SELECT worker, token FROM joins WHERE seen_us<? "
        "AND worker NOT IN (SELECT id FROM workers)",
        {unseen_since_us}, [&](const SqlRow& row) {
          const std::string token = row.text(1);
          const bool is_valid = std::find(valid.begin(), valid.end(), token) != valid.end();
          if (!is_valid) gone.emplace_back(row.text(0), token);
        });
    for (const auto& [worker, token] : gone) {
      if (!status.ok()) return status;
      status = rows.run("DELETE FROM joins WHERE worker=? AND token=?", {worker, token});
    }
    return status;
  });
}

}  // namespace tessera::server
