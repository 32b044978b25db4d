#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera::server {

class Database;

/// Copies what can be read of a table of the attached database `damaged` into the empty table of
/// the same name in `main`.
class TableSalvage {
 public:
  /// `rows` must outlive the salvage. Errors: those of Database.
  static absl::StatusOr<TableSalvage> create(Database& rows, const std::string& table);

  /// Errors: those of writing to `main`; damage of the other database is none.
  absl::Status run();

  std::int64_t copied() const { return copied_; }
  /// Places at which an unknown number of rows is lost.
  int gaps() const { return gaps_; }

 private:
  TableSalvage(Database& rows, std::string table) : rows_(rows), table_(std::move(table)) {}

  absl::Status read_columns();
  absl::Status copy_upwards();
  absl::Status copy_downwards();
  absl::StatusOr<std::int64_t> copy_chunk(const std::string& into, const std::string& condition,
                                          std::string_view order, std::int64_t from);
  absl::Status pass_gap(std::optional<std::int64_t>& from);
  absl::Status find_readable(std::int64_t above, std::optional<std::int64_t>& found);
  absl::Status look(std::int64_t from, std::optional<std::int64_t>& first);
  std::string keys(std::string_view order) const;

  Database& rows_;
  std::string table_;
  std::string columns_;           // separated by commas
  std::vector<std::string> key_;  // by which the rows are sorted on disk
  bool has_number_ = false;       // the first column of the key is an integer
  std::int64_t copied_ = 0;
  int gaps_ = 0;
};

}  // namespace tessera::server
