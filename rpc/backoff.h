#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <random>

namespace tessera::contract {

/// Pauses between attempts to reach a server. Each is drawn from the upper half of a span that
/// doubles up to a maximum, so that callers that lose a server together do not all come back in the
/// same moment. One thread at a time.
class Backoff {
 public:
  /// Requires: 0 < first <= max.
  Backoff(std::chrono::milliseconds first, std::chrono::milliseconds max,
          std::uint32_t seed = std::random_device{}())
      : first_(first), max_(max), span_(first), random_(seed) {}

  /// Returns the next pause.
  std::chrono::milliseconds next() {
    std::uniform_int_distribution<std::int64_t> jitter(span_.count() / 2, span_.count());
    span_ = std::min(2 * span_, max_);
    return std::chrono::milliseconds(jitter(random_));
  }
  /// Starts again with the first span. Call after a success.
  void reset() { span_ = first_; }

 private:
  const std::chrono::milliseconds first_, max_;
  std::chrono::milliseconds span_;
  std::mt19937 random_;
};

}  // namespace tessera::contract
