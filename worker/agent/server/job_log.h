#pragma once

#include <chrono>
#include <deque>
#include <optional>
#include <string>

#include "telemetry/log/log.h"
#include "tessera/v1/worker_service.pb.h"
#include "worker/agent/units/unit_queue.h"

namespace tessera::agent {

/// Writes a log line about a job; an empty `job_id` means no job.
using JobLog = std::function<void(LogLevel, const std::string& job_id, const std::string& line)>;

/// Returns `text` with invalid UTF-8 bytes replaced by '?': protobuf rejects them.
std::string valid_utf8(std::string text);

/// Queue of log lines about jobs for the server, where `tessera logs` reads them. When it is full
/// the oldest lines are dropped. Lines are sent at kLinesPerSecond at most, after a burst of
/// kBurst.
class JobLogForwarder {
 public:
  static constexpr std::size_t kMaxWaiting = 256, kMaxInMessage = 64;
  static constexpr double kLinesPerSecond = 20, kBurst = 200;
  static constexpr std::size_t kMaxLineBytes = 1024;

  void add(LogLevel level, const std::string& job_id, const std::string& line);
  /// Returns the lines that may be sent now, with a note about dropped ones; nullopt if there are
  /// none.
  std::optional<v1::LogLines> take(Time now);

 private:
  std::deque<v1::LogLine> waiting_;
  std::int64_t dropped_count_ = 0;  // lines dropped since the last message
  double allowance_ = kBurst;       // lines that may be sent now
  std::optional<Time> taken_;       // when the allowance was last updated
};

}  // namespace tessera::agent
