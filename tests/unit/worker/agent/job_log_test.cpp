#include "worker/agent/server/job_log.h"

#include <gtest/gtest.h>

#include <chrono>
#include <string>

namespace tessera::agent {
namespace {

int lines_in(const std::optional<v1::LogLines>& lines) {
  return lines ? lines->lines_size() : 0;
}

TEST(JobLogForwarder, SendsLinesInOrderWithLevelAndJob) {
  JobLogForwarder relay;
  EXPECT_FALSE(relay.take(Time{}));
  relay.add(LogLevel::info, "j", "first");
  relay.add(LogLevel::warn, "j", "second");
  const auto lines = relay.take(Time{});
  ASSERT_EQ(lines_in(lines), 2);
  EXPECT_EQ(lines->lines(0).message(), "first");
  EXPECT_EQ(lines->lines(1).job_id(), "j");
  EXPECT_EQ(lines->lines(1).level(), v1::LogLine::LEVEL_WARNING);
  EXPECT_FALSE(relay.take(Time{}));
}

TEST(JobLogForwarder, RateIsLimitedAfterBurst) {
  JobLogForwarder relay;
  Time now{};
  int sent = 0;
  for (int ms = 0; ms < 60'000; ms += 10) {
    relay.add(LogLevel::debug, "j", "again");
    sent += lines_in(relay.take(now));
    now += std::chrono::milliseconds(10);
  }
  // 100 lines a second arrived; the notes about dropped lines add at most one line per message.
  EXPECT_GE(sent, JobLogForwarder::kBurst + 59 * JobLogForwarder::kLinesPerSecond);
  EXPECT_LE(sent, 2 * (JobLogForwarder::kBurst + 60 * JobLogForwarder::kLinesPerSecond));
}

TEST(JobLogForwarder, DropsOldestLinesAndCountsThem) {
  JobLogForwarder relay;
  const int count = static_cast<int>(JobLogForwarder::kMaxWaiting) + 7;
  for (int i = 0; i < count; ++i) relay.add(LogLevel::info, "j", std::to_string(i));
  const auto lines = relay.take(Time{});
  ASSERT_EQ(lines_in(lines), static_cast<int>(JobLogForwarder::kMaxInMessage));
  EXPECT_EQ(lines->lines(0).message(), "7 log lines dropped (rate limit)");
  EXPECT_EQ(lines->lines(1).message(), "7");
}

TEST(JobLogForwarder, ReplacesInvalidUtf8) {
  EXPECT_EQ(valid_utf8("gr\xC3\xBC\xC3\x9F"), "gr\xC3\xBC\xC3\x9F");
  EXPECT_EQ(valid_utf8("\xE2\x82\xAC \xF0\x9F\x99\x82"), "\xE2\x82\xAC \xF0\x9F\x99\x82");
  EXPECT_EQ(valid_utf8("a\xFFz"), "a?z");
  EXPECT_EQ(valid_utf8("cut \xE2\x82"), "cut ??");
  EXPECT_EQ(valid_utf8("\xC0\xAF \xED\xA0\x80"), "?? ???");  // an overlong encoding; a surrogate
  JobLogForwarder relay;
  relay.add(LogLevel::info, "j", "\xFF" + std::string(3000, 'x'));
  const auto lines = relay.take(Time{});
  ASSERT_EQ(lines_in(lines), 1);
  EXPECT_EQ(lines->lines(0).message(), "?" + std::string(JobLogForwarder::kMaxLineBytes - 1, 'x'));
}

}  // namespace
}  // namespace tessera::agent
