#include "worker/agent/server/job_log.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {
namespace {

/// Returns the length in bytes of the UTF-8 character at `text[at]`; 0 if it is not valid. Overlong
/// forms and surrogates are invalid (Unicode 15, table 3-7).
std::size_t character_bytes(const std::string& text, std::size_t at) {
  const auto byte = [&](std::size_t i) {
    return at + i < text.size() ? static_cast<unsigned char>(text[at + i]) : 0U;
  };
  const auto follows = [&](std::size_t i, unsigned low = 0x80, unsigned high = 0xBF) {
    return byte(i) >= low && byte(i) <= high;
  };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  if (first >= 0xC2 && first <= 0xDF) return follows(1) ? 2 : 0;
  if (first >= 0xE0 && first <= 0xEF) {
    const bool is_valid = follows(1, first == 0xE0 ? 0xA0 : 0x80, first == 0xED ? 0x9F : 0xBF);
    return is_valid && follows(2) ? 3 : 0;
  }
  if (first >= 0xF0 && first <= 0xF4) {
    const bool is_valid = follows(1, first == 0xF0 ? 0x90 : 0x80, first == 0xF4 ? 0x8F : 0xBF);
    return is_valid && follows(2) && follows(3) ? 4 : 0;
  }
  return 0;
}

v1::LogLine::Level level_of(LogLevel level) {
  switch (level) {
    case LogLevel::debug:
      return v1::LogLine::LEVEL_DEBUG;
    case LogLevel::warn:
      return v1::LogLine::LEVEL_WARNING;
    case LogLevel::error:
      return v1::LogLine::LEVEL_ERROR;
    case LogLevel::info:
      break;
  }
  return v1::LogLine::LEVEL_INFO;
}

}  // namespace

std::string valid_utf8(std::string text) {
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t bytes = character_bytes(text, at);
    if (bytes == 0) text[at] = '?';
    at += std::max<std::size_t>(bytes, 1);
  }
  return text;
}

void JobLogForwarder::add(LogLevel level, const std::string& job_id, const std::string& line) {
  v1::LogLine& kept = waiting_.emplace_back();
  kept.set_job_id(job_id);
  kept.set_level(level_of(level));
  kept.set_message(valid_utf8(line.substr(0, kMaxLineBytes)));
  if (waiting_.size() <= kMaxWaiting) return;
  waiting_.pop_front();
  ++dropped_count_;
}

std::optional<v1::LogLines> JobLogForwarder::take(Time now) {
  if (taken_) {
    const std::chrono::duration<double> passed = now - *taken_;
    allowance_ = std::min(kBurst, allowance_ + kLinesPerSecond * passed.count());
  }
  taken_ = now;
  if (waiting_.empty() || allowance_ < 1) return std::nullopt;
  v1::LogLines lines;
  if (dropped_count_ > 0) {
    v1::LogLine& note = *lines.add_lines();
    note.set_job_id(waiting_.front().job_id());
    note.set_level(v1::LogLine::LEVEL_WARNING);
    note.set_message(
        absl::StrCat(std::exchange(dropped_count_, 0), " log lines dropped (rate limit)"));
  }
  while (!waiting_.empty() && allowance_ >= 1 &&
         lines.lines_size() < static_cast<int>(kMaxInMessage)) {
    *lines.add_lines() = std::move(waiting_.front());
    waiting_.pop_front();
    --allowance_;
  }
  return lines;
}

}  // namespace tessera::agent
