#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace tessera::client {

/// Rows of text in aligned columns, two spaces apart; the last column is not padded. Control
/// characters, which may come from other users of the farm, are escaped.
class Table {
 public:
  explicit Table(std::vector<std::string> header) : rows_{std::move(header)} {}
  /// Adds a row. Requires as many cells as the header has.
  void add(std::vector<std::string> row);
  std::string text() const;

 private:
  std::vector<std::vector<std::string>> rows_;
};

/// Returns the first line of UTF-8 text, at most `most` characters of it, and "…" if there is more.
std::string beginning_of_line(const std::string& text, std::size_t most);

/// Formats bytes with one decimal: 1536 -> "1.5 KiB".
std::string format_bytes(double bytes);

/// Formats a box as "(0, 0, 0) to (1, 2, 3)". Coordinates are rounded to 2^-23 of the largest, the
/// precision of vertices, so that 0 is printed where only rounding errors are left.
std::string format_box(const std::array<double, 3>& low, const std::array<double, 3>& high);

/// Formats part / total as "12.3 %"; "-" if `total` is 0.
std::string format_share(double part, double total);

}  // namespace tessera::client
