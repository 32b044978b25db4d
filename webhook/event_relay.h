#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "webhook/http_poster.h"
#include "telemetry/log/log.h"
#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// Passes a farm's events on, in order, each at least once.
class EventRelay {
 public:
  struct Options {
    std::vector<std::string> kinds;  // names as in event_names(); empty: all but lines of logs
    std::string state_file;          // where the last sequence is kept; empty: nowhere
    absl::Duration first_wait = absl::Seconds(1), longest_wait = absl::Minutes(1);
  };

  EventRelay(HttpPoster& poster, Options options, Log log);

  /// The last event that was passed on when the state file was written; nullopt: there is none.
  /// Errors: InvalidArgument, the file holds something else.
  absl::StatusOr<std::optional<std::int64_t>> last_sequence() const;

  /// Posts the event, if it is of a wanted kind, until it is taken, with waits that double from try
  /// to try. One that is refused for good is left out, and logged.
  /// Errors: Cancelled after cancel(); those of writing the state file.
  absl::Status pass(const v1::Event& event);

  /// Notes a sequence as passed on.
  absl::Status remember(std::int64_t sequence);

  /// Ends pass() soon. From any thread, once.
  void cancel();

 private:
  absl::Status post(const v1::Event& event);

  HttpPoster& poster_;
  const Options options_;
  const Log log_;
  absl::Notification cancelled_;
};

}  // namespace tessera::client
