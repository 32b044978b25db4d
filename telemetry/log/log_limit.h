#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>

namespace tessera {

/// Limits the rate of log lines whose number others determine. Thread-safe.
class LogLimit {
 public:
  using Time = std::chrono::steady_clock::time_point;

  /// Allows `lines` lines per `period`. Requires both to be positive.
  LogLimit(int lines, std::chrono::seconds period) : lines_(lines), period_(period) {}

  /// Returns nothing if a line must be left out at the time `now`, else the number of lines that
  /// were left out since the last one.
  std::optional<std::int64_t> admit(Time now);

 private:
  const int lines_;
  const std::chrono::seconds period_;
  std::mutex mutex_;
  std::optional<Time> period_begin_;
  int written_ = 0;  // in this period
  std::int64_t left_out_ = 0;
};

}  // namespace tessera
