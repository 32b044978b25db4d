#pragma once

#include <cstdint>

namespace tessera::testing {

/// Random numbers of a seed. Source: SplitMix64 (Steele, Lea, Flood 2014).
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : state_(seed) {}

  std::uint64_t next() {
    std::uint64_t x = state_ += 0x9e3779b97f4a7c15;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9;
    x = (x ^ (x >> 27)) * 0x94d049bb133111eb;
    return x ^ (x >> 31);
  }
  /// 0 to limit - 1; 0 if `limit` is not positive.
  int below(int limit) {
    return limit <= 0 ? 0 : static_cast<int>(next() % static_cast<std::uint64_t>(limit));
  }
  bool one_in(int count) { return below(count) == 0; }

 private:
  std::uint64_t state_;
};

}  // namespace tessera::testing
