#pragma once

#include <cstdint>
#include <iterator>
#include <string>

#include "server/store/sqlite/schema.h"

namespace tessera::server {

/// Returns SQL that turns the tables of this program's schema into those of schema `version`, from
/// 1, as an older program wrote them.
inline std::string sql_to_older_schema(std::int64_t version) {
  // Step n undoes the migration from schema n + 1 to n + 2.
  constexpr const char* kSteps[] = {
      "DROP TABLE joins;",
      "ALTER TABLE units DROP COLUMN audit;",
      "DROP TABLE bans; ALTER TABLE assets DROP COLUMN used_us;",
      "DROP TABLE totals; ALTER TABLE joins DROP COLUMN seen_us;",
      "ALTER TABLE jobs DROP COLUMN render_contract;",
      "ALTER TABLE jobs DROP COLUMN failure_code;",
      "DROP TABLE blocks; DROP TABLE images;",
      "DROP TABLE settings;",
      "DROP TABLE asset_contents;",
      "DROP TABLE usage; DROP TABLE events; ALTER TABLE units DROP COLUMN hour; "
      "ALTER TABLE jobs DROP COLUMN project; ALTER TABLE jobs DROP COLUMN failed_attempts; "
      "ALTER TABLE store DROP COLUMN dropped_event;",
      "DROP VIEW accounts; DROP TABLE past_usage; DROP INDEX removed_jobs;",
      "ALTER TABLE jobs DROP COLUMN end_served_us;",
  };
  std::string sql;
  for (std::int64_t step = schema_version() - 1; step >= version; --step) {
    sql += step <= std::ssize(kSteps) ? kSteps[step - 1] : "a step is missing in older_schema.h;";
  }
  return sql + "PRAGMA user_version=" + std::to_string(version);
}

}  // namespace tessera::server
