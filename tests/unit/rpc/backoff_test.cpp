#include "rpc/backoff.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>

namespace tessera::contract {
namespace {

using namespace std::chrono_literals;

TEST(Backoff, PausesAreInUpperHalfOfDoublingSpan) {
  for (std::uint32_t seed = 0; seed < 1000; ++seed) {
    Backoff backoff(50ms, 2s, seed);
    for (const auto span : {50ms, 100ms, 200ms, 400ms, 800ms, 1600ms, 2000ms, 2000ms}) {
      const auto pause = backoff.next();
      ASSERT_GE(pause, span / 2) << "seed " << seed;
      ASSERT_LE(pause, span) << "seed " << seed;
    }
  }
}

/// The longest pauses of 5,000 workers: a tenth of them is expected in each tenth of the span. The
/// standard deviation is sqrt(5000 · 0.1 · 0.9) = 21, and 120 is more than five of these.
TEST(Backoff, CallersThatLoseServerTogetherComeBackSpread) {
  std::array<int, 10> callers = {};
  for (std::uint32_t seed = 0; seed < 5000; ++seed) {
    Backoff backoff(2s, 2s, seed);
    const auto pause = backoff.next() - 1000ms;
    ++callers.at(static_cast<std::size_t>(std::min<std::int64_t>(pause.count() / 100, 9)));
  }
  for (const int count : callers) EXPECT_NEAR(count, 500, 120);
}

TEST(Backoff, OwnSeedsDiffer) {
  std::array<std::int64_t, 8> pauses = {};
  for (std::int64_t& pause : pauses) {
    Backoff backoff(1'000'000ms, 1'000'000ms);
    pause = backoff.next().count();
  }
  // All eight are equal with a probability of 500,000 to the power of -7.
  EXPECT_LT(std::count(pauses.begin(), pauses.end(), pauses[0]), 8);
}

TEST(Backoff, ResetStartsWithFirstSpan) {
  Backoff backoff(50ms, 2s, 1);
  for (int i = 0; i < 6; ++i) backoff.next();
  EXPECT_GE(backoff.next(), 1000ms);
  backoff.reset();
  EXPECT_LE(backoff.next(), 50ms);
}

}  // namespace
}  // namespace tessera::contract
