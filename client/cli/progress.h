#pragma once

#include <string>

#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// One line for people: bar, share done, samples, estimated error, workers, time left.
/// `columns`: width of the line; the bar takes what the figures leave, at most 40.
std::string progress_line(const v1::Job& job, int columns);

/// 42 -> "42 s", 125 -> "2:05", 7384 -> "2:03:04".
std::string format_seconds(double seconds);

/// 950 -> "950", 59e6 -> "59.0 M".
std::string format_count(double count);

/// Redraws progress_line on stderr while that is a terminal; silent otherwise.
class ProgressBar {
 public:
  ProgressBar();
  ~ProgressBar() { clear(); }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  void show(const v1::Job& job);
  /// Wipes the line, so that something else can be printed.
  void clear();

 private:
  bool terminal_;
  bool drawn_ = false;
};

}  // namespace tessera::client
