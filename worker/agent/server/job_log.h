#pragma once

#include <chrono>
#include <deque>
#include <optional>
#include <string>

#include "telemetry/log/log.h"
#include "tessera/v1/worker_service.pb.h"
#include "worker/agent/units/unit_queue.h"

namespace tessera::agent {

/// Writes a line about a job (its id; empty: about none).
using JobLog = std::function<void(LogLevel, const std::string& job_id, const std::string& line)>;

/// `text` with what is not UTF-8 replaced by '?': protobuf refuses it.
std::string valid_utf8(std::string text);

/// Lines about jobs that wait for the server, where `tessera logs` reads them. Bounded: of what
/// waits the oldest goes first, and lines are sent at most at kLinesPerSecond, after a burst.
class JobLogForwarder {
 public:
  static constexpr std::size_t kMaxWaiting = 256, kMaxInMessage = 64;
  static constexpr double kLinesPerSecond = 20, kBurst = 200;
  static constexpr std::size_t kMaxLineBytes = 1024;

  void add(LogLevel level, const std::string& job_id, const std::string& line);
  /// What may be sent now; says how many lines were left out. nullopt: nothing.
  std::optional<v1::LogLines> take(Time now);

 private:
  std::deque<v1::LogLine> waiting_;
  std::int64_t left_out_ = 0;  // since the last message
  double allowance_ = kBurst;  // lines that may be sent now
  std::optional<Time> taken_;  // when the allowance was last reckoned
};

}  // namespace tessera::agent
