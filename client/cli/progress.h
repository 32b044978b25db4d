#pragma once

#include <google/protobuf/duration.pb.h>

#include <string>

#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// Returns a progress line of at most `columns` characters: bar, percentage, samples, estimated
/// error, workers, remaining time. The bar has at most 40 characters.
std::string progress_line(const v1::Job& job, int columns);

/// Converts a duration to seconds.
double to_seconds(const google::protobuf::Duration& span);

/// Formats seconds: 42 -> "42 s", 125 -> "2:05", 7384 -> "2:03:04".
std::string format_seconds(double seconds);

/// Formats a count: 950 -> "950", 59e6 -> "59.0 M".
std::string format_count(double count);

/// Draws progress_line on stderr if it is a terminal.
class ProgressBar {
 public:
  ProgressBar();
  ~ProgressBar() { clear(); }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  void show(const v1::Job& job);
  /// Erases the line before other output.
  void clear();

 private:
  bool terminal_;
  bool drawn_ = false;
};

}  // namespace tessera::client
