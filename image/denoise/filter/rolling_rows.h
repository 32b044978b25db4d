#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace tessera::image {

/// Rows [begin, end) of a plane, which grow at the bottom and are dropped from the top.
template <typename T>
class RollingRows {
 public:
  RollingRows(std::int32_t width, std::int32_t first) : width_(width), begin_(first), end_(first) {}

  std::int32_t width() const { return width_; }
  std::int32_t begin() const { return begin_; }
  std::int32_t end() const { return end_; }
  T* row(std::int32_t y) { return values_.data() + offset(y); }
  const T* row(std::int32_t y) const { return values_.data() + offset(y); }

  /// Adds rows of T{} up to `end`.
  void extend(std::int32_t end) {
    end_ = std::max(end_, end);
    values_.resize(offset(end_));
  }
  /// Drops the rows above `begin`.
  void drop(std::int32_t begin) {
    begin = std::clamp(begin, begin_, end_);
    values_.erase(values_.begin(), values_.begin() + static_cast<std::ptrdiff_t>(offset(begin)));
    begin_ = begin;
  }

 private:
  std::size_t offset(std::int32_t y) const {
    return static_cast<std::size_t>(y - begin_) * static_cast<std::size_t>(width_);
  }

  std::int32_t width_, begin_, end_;
  std::vector<T> values_;
};

}  // namespace tessera::image
