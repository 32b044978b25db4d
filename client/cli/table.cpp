#include "client/cli/table.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "telemetry/log/printable.h"

namespace tessera::client {
namespace {

/// Returns whether a byte of UTF-8 text is the first one of a character.
bool begins_character(char c) {
  return (static_cast<unsigned>(c) & 0xC0u) != 0x80u;
}

/// Returns the number of characters, not bytes, of UTF-8 text.
std::size_t columns_of(const std::string& text) {
  return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), begins_character));
}

}  // namespace

void Table::add(std::vector<std::string> row) {
  for (std::string& cell : row) cell = printable(cell);
  rows_.push_back(std::move(row));
}

std::string Table::text() const {
  std::vector<std::size_t> widths(rows_.front().size());
  for (const auto& row : rows_) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      widths[i] = std::max(widths[i], columns_of(row[i]));
    }
  }
  std::string text;
  for (const auto& row : rows_) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      text += row[i];
      if (i + 1 < row.size()) text.append(widths[i] - columns_of(row[i]) + 2, ' ');
    }
    text += '\n';
  }
  return text;
}

std::string beginning_of_line(const std::string& text, std::size_t most) {
  std::size_t end = 0, characters = 0;
  for (; end < text.size() && text[end] != '\n'; ++end) {
    if (begins_character(text[end]) && ++characters > most) break;
  }
  return end == text.size() ? text : text.substr(0, end) + "…";
}

std::string format_bytes(double bytes) {
  static constexpr const char* kUnits[] = {"B", "KiB", "MiB", "GiB", "TiB"};
  std::size_t unit = 0;
  while (bytes >= 1024 && unit + 1 < std::size(kUnits)) {
    bytes /= 1024;
    ++unit;
  }
  return unit == 0 ? absl::StrFormat("%.0f B", bytes)
                   : absl::StrFormat("%.1f %s", bytes, kUnits[unit]);
}

std::string format_box(const std::array<double, 3>& low, const std::array<double, 3>& high) {
  double largest = 0;
  for (const auto* corner : {&low, &high}) {
    for (const double each : *corner) largest = std::max(largest, std::fabs(each));
  }
  const double step = largest * 0x1p-23;
  const auto rounded = [step](double value) {
    return step > 0 ? std::round(value / step) * step + 0.0 : 0.0;  // + 0.0 turns -0 into 0
  };
  const auto point = [&rounded](const std::array<double, 3>& p) {
    return absl::StrFormat("(%.4g, %.4g, %.4g)", rounded(p[0]), rounded(p[1]), rounded(p[2]));
  };
  return absl::StrCat(point(low), " to ", point(high));
}

std::string format_share(double part, double total) {
  return total > 0 ? absl::StrFormat("%.1f %%", 100 * part / total) : "-";
}

}  // namespace tessera::client
