#include "server/store/maintenance/table_salvage.h"

#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/store/sqlite/database.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kChunkRows = 1024;
constexpr std::int64_t kLargest = std::numeric_limits<std::int64_t>::max();

/// Whether a row could not be read, or violates a constraint, so that its bytes are damaged.
bool is_damage(const absl::Status& status) {
  return absl::IsDataLoss(status) || absl::IsAlreadyExists(status);
}

}  // namespace

absl::StatusOr<TableSalvage> TableSalvage::create(Database& rows, const std::string& table) {
  TableSalvage salvage(rows, table);
  if (absl::Status read = salvage.read_columns(); !read.ok()) return read;
  return salvage;
}

absl::Status TableSalvage::read_columns() {
  bool has_row_id = false;
  absl::Status status =
      rows_.each("SELECT NOT wr FROM pragma_table_list WHERE schema='main' AND name=?", {table_},
                 [&](const SqlRow& row) { has_row_id = row.integer(0) != 0; });
  std::vector<std::string> columns;
  std::vector<std::pair<std::int64_t, std::string>> parts;  // of the primary key
  status.Update(rows_.each("SELECT name, type, pk FROM pragma_table_info(?, 'main')", {table_},
                           [&](const SqlRow& row) {
                             columns.push_back(row.text(0));
                             if (row.integer(2) > 0)
                               parts.emplace_back(row.integer(2), row.text(0));
                             if (row.integer(2) == 1) has_number_ = row.text(1) == "INTEGER";
                           }));
  if (!status.ok()) return status;
  // A row ID is its own key, unless a column is another name for it.
  if (has_row_id && !(parts.size() == 1 && has_number_)) {
    columns.insert(columns.begin(), "rowid");
    parts = {{1, "rowid"}};
    has_number_ = true;
  }
  key_.resize(parts.size());
  for (auto& [number, name] : parts) key_[static_cast<std::size_t>(number - 1)] = std::move(name);
  columns_ = absl::StrJoin(columns, ", ");
  return absl::OkStatus();
}

absl::Status TableSalvage::run() {
  absl::Status status = copy_upwards();
  if (status.ok() && gaps_ > 0 && (!has_number_ || key_.size() > 1)) status = copy_downwards();
  if (!status.ok()) return status;
  return rows_.each(absl::StrCat("SELECT COUNT(*) FROM main.", table_), {},
                    [&](const SqlRow& row) { copied_ = row.integer(0); });
}

/// Copies rows by ascending keys. Behind a gap it goes on with the first key that can be read.
absl::Status TableSalvage::copy_upwards() {
  const std::string main = absl::StrCat("main.", table_);
  const std::string after_last = absl::StrCat("(", keys(""), ") > (SELECT ", keys(""), " FROM ",
                                              main, " ORDER BY ", keys(" DESC"), " LIMIT 1)");
  std::optional<std::int64_t> from;  // the first number of the key, behind a gap
  for (bool is_empty = true;;) {
    const std::string condition = from       ? absl::StrCat(key_.front(), ">=?1")
                                  : is_empty ? "?1=?1"
                                             : absl::StrCat("?1=?1 AND ", after_last);
    const auto copied = copy_chunk(main, condition, "", from.value_or(0));
    if (copied.ok()) {
      if (*copied == 0) return absl::OkStatus();
      is_empty = false;
      from.reset();
      continue;
    }
    if (!is_damage(copied.status())) return copied.status();
    if (!has_number_) {
      ++gaps_;
      return absl::OkStatus();
    }
    if (absl::Status passed = pass_gap(from); !passed.ok()) return passed;
    if (!from) return absl::OkStatus();
  }
}

/// Copies rows by descending keys up to the last gap.
absl::Status TableSalvage::copy_downwards() {
  absl::Status status = rows_.run(absl::StrCat("CREATE TEMP TABLE tail AS SELECT ", columns_,
                                               " FROM main.", table_, " LIMIT 0"));
  const std::string before_last = absl::StrCat("?1=?1 AND (", keys(""), ") < (SELECT ", keys(""),
                                               " FROM temp.tail ORDER BY rowid DESC LIMIT 1)");
  std::string condition = "?1=?1";
  while (status.ok()) {
    const auto copied = copy_chunk("temp.tail", condition, " DESC", 0);
    if (!copied.ok() && !is_damage(copied.status())) return copied.status();
    if (!copied.ok() || *copied == 0) break;
    condition = before_last;
  }
  status.Update(rows_.run(absl::StrCat("INSERT OR IGNORE INTO main.", table_, "(", columns_,
                                       ") SELECT ", columns_, " FROM temp.tail")));
  status.Update(rows_.run("DROP TABLE temp.tail"));
  return status;
}

/// Copies as many of the next rows as can be read at once, and returns their number. `condition`
/// contains `from` as ?1. Errors: is_damage(), the next row cannot be read.
absl::StatusOr<std::int64_t> TableSalvage::copy_chunk(const std::string& into,
                                                      const std::string& condition,
                                                      std::string_view order, std::int64_t from) {
  const std::string sql =
      absl::StrCat("INSERT INTO ", into, "(", columns_, ") SELECT ", columns_, " FROM damaged.",
                   table_, " WHERE ", condition, " ORDER BY ", keys(order), " LIMIT ?2");
  absl::Status status;
  for (std::int64_t limit = kChunkRows; limit > 0; limit /= 4) {
    status = rows_.run(sql, {from, limit});
    if (status.ok()) return rows_.changes();
    if (!is_damage(status)) break;
  }
  return status;
}

/// Sets `from` to the first number of the next key that can be read, and to nothing if there is
/// none. Until then it is where copying failed, or nothing if that is behind the last copied row.
absl::Status TableSalvage::pass_gap(std::optional<std::int64_t>& from) {
  std::int64_t above = from.value_or(-1);
  if (!from) {
    ++gaps_;
    absl::Status status = rows_.each(absl::StrCat("SELECT ", key_.front(), " FROM main.", table_,
                                                  " ORDER BY ", keys(" DESC"), " LIMIT 1"),
                                     {}, [&](const SqlRow& row) { above = row.integer(0); });
    if (!status.ok()) return status;
  }
  return find_readable(above, from);
}

/// Sets `found` to the least number above `above` of a key that can be read. Looking for a key
/// inside of a damaged page fails, and succeeds behind it.
absl::Status TableSalvage::find_readable(std::int64_t above, std::optional<std::int64_t>& found) {
  std::int64_t failed = above, works = above;
  for (std::int64_t step = 1; works == above; step *= 2) {
    if (step > kLargest / 4 || above > kLargest - step) {
      found.reset();
      return absl::OkStatus();
    }
    absl::Status status = look(above + step, found);
    if (status.ok()) {
      works = above + step;
    } else if (is_damage(status)) {
      failed = above + step;
    } else {
      return status;
    }
  }
  while (works - failed > 1) {
    const std::int64_t middle = failed + (works - failed) / 2;
    std::optional<std::int64_t> first;
    absl::Status status = look(middle, first);
    if (!status.ok() && !is_damage(status)) return status;
    if (status.ok()) found = first;
    (status.ok() ? works : failed) = middle;
  }
  return absl::OkStatus();
}

/// Reads the first number of the first key from `from`.
absl::Status TableSalvage::look(std::int64_t from, std::optional<std::int64_t>& first) {
  first.reset();
  return rows_.each(absl::StrCat("SELECT ", key_.front(), " FROM damaged.", table_, " WHERE ",
                                 key_.front(), ">=? ORDER BY ", keys(""), " LIMIT 1"),
                    {from}, [&](const SqlRow& row) { first = row.integer(0); });
}

/// Returns the columns of the key, each with `order`.
std::string TableSalvage::keys(std::string_view order) const {
  return absl::StrJoin(key_, ", ", [order](std::string* out, const std::string& column) {
    out->append(column).append(order);
  });
}

}  // namespace tessera::server
