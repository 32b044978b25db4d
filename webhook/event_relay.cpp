#include "webhook/event_relay.h"

#include <algorithm>
#include <fstream>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "client/api/event_document.h"
#include "client/output/frame_files.h"

namespace tessera::client {

EventRelay::EventRelay(HttpPoster& poster, Options options, Log log)
    : poster_(poster), options_(std::move(options)), log_(std::move(log)) {}

absl::StatusOr<std::optional<std::int64_t>> EventRelay::last_sequence() const {
  std::ifstream file(options_.state_file);
  if (options_.state_file.empty() || !file) return std::nullopt;
  std::string text;
  std::getline(file, text);
  std::int64_t sequence = 0;
  if (!absl::SimpleAtoi(text, &sequence) || sequence < 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(options_.state_file, ": not a state file of tessera-webhook"));
  }
  return sequence;
}

absl::Status EventRelay::remember(std::int64_t sequence) {
  if (options_.state_file.empty()) return absl::OkStatus();
  return write_text_file(options_.state_file, absl::StrCat(sequence, "\n"));
}

absl::Status EventRelay::forward(const v1::Event& event) {
  const std::string name = event_name(event.kind());
  const bool is_selected = options_.events.empty() ? event.kind() != v1::Event::KIND_LOG_LINE
                                                   : std::count(options_.events.begin(),
                                                                options_.events.end(), name) > 0;
  if (!is_selected) return absl::OkStatus();
  if (absl::Status status = post(event); !status.ok()) return status;
  return remember(event.sequence());
}

absl::Status EventRelay::post(const v1::Event& event) {
  const std::string body = event_document(event).dump();
  absl::Duration wait = options_.first_wait;
  for (int failures = 0;; ++failures) {
    absl::Status status = poster_.post(body);
    if (status.ok() && failures > 0) log_(LogLevel::info, "the receiver accepts events again");
    if (status.ok() || absl::IsCancelled(status)) return status;
    const std::string description = absl::StrCat("event ", event.sequence(), " (",
                                                 event_name(event.kind()), "): ", status.message());
    if (!absl::IsUnavailable(status)) {
      log_(LogLevel::error, absl::StrCat(description, "; skipped"));
      return absl::OkStatus();
    }
    const absl::Duration pause =
        std::max(wait, std::min(poster_.retry_after(), 10 * options_.max_wait));
    log_(LogLevel::warn, absl::StrCat(description, "; retrying in ", absl::FormatDuration(pause)));
    if (cancelled_.WaitForNotificationWithTimeout(pause))
      return absl::CancelledError("interrupted");
    wait = std::min(2 * wait, options_.max_wait);
  }
}

void EventRelay::cancel() {
  cancelled_.Notify();
  poster_.cancel();
}

}  // namespace tessera::client
