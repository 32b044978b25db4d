#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "telemetry/log/log.h"
#include "tessera/v1/job_service.pb.h"
#include "webhook/http_poster.h"

namespace tessera::client {

/// Posts a farm's events in order, each at least once.
class EventRelay {
 public:
  struct Options {
    std::vector<std::string> events;  // names of event_names(); empty: all but log lines
    std::string state_file;           // stores the last sequence; empty: none
    absl::Duration first_wait = absl::Seconds(1), max_wait = absl::Minutes(1);
  };

  EventRelay(HttpPoster& poster, Options options, Log log);

  /// Returns the sequence in the state file; nullopt if there is none. Errors: InvalidArgument, the
  /// file does not contain a sequence.
  absl::StatusOr<std::optional<std::int64_t>> last_sequence() const;

  /// Posts the event, if it is selected, until the receiver accepts it, with exponential back-off.
  /// Skips and logs an event that the receiver rejects. Errors: Cancelled after cancel(); those of
  /// writing the state file.
  absl::Status forward(const v1::Event& event);

  /// Writes the sequence of the last forwarded event to the state file.
  absl::Status remember(std::int64_t sequence);

  /// Makes forward() return soon. Thread-safe; call at most once.
  void cancel();

 private:
  absl::Status post(const v1::Event& event);

  HttpPoster& poster_;
  const Options options_;
  const Log log_;
  absl::Notification cancelled_;
};

}  // namespace tessera::client
