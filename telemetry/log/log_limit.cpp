#include "telemetry/log/log_limit.h"

#include <utility>

namespace tessera {

std::optional<std::int64_t> LogLimit::admit(Time now) {
  const std::lock_guard lock(mutex_);
  if (!period_begin_ || now - *period_begin_ >= period_) {
    period_begin_ = now;
    written_ = 0;
  }
  if (written_ == lines_) {
    ++left_out_;
    return std::nullopt;
  }
  ++written_;
  return std::exchange(left_out_, 0);
}

}  // namespace tessera
