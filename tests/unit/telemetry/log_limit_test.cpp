#include "telemetry/log/log_limit.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>

namespace tessera {
namespace {

using std::chrono::seconds;

TEST(LogLimit, LinesBeyondLimitAreCounted) {
  LogLimit limit(2, seconds(60));
  const LogLimit::Time start{};
  EXPECT_EQ(limit.admit(start), 0);
  EXPECT_EQ(limit.admit(start + seconds(1)), 0);
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(limit.admit(start + seconds(59)));
  EXPECT_EQ(limit.admit(start + seconds(60)), 5);
  EXPECT_EQ(limit.admit(start + seconds(61)), 0);
  EXPECT_FALSE(limit.admit(start + seconds(61)));
  EXPECT_EQ(limit.admit(start + seconds(1000)), 1);
}

TEST(LogLimit, SlowLinesAreAllWritten) {
  LogLimit limit(2, seconds(60));
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(limit.admit(LogLimit::Time{} + seconds(30 * i)), 0) << i;
  }
}

}  // namespace
}  // namespace tessera
