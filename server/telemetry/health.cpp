#include "server/telemetry/health.h"

#include <utility>

#include "absl/strings/str_format.h"

namespace tessera::server {

Health::Health(std::function<Time()> clock)
    : clock_(std::move(clock)), timer_(now()), writer_(now()) {}

double Health::seconds_since(const std::atomic<Duration::rep>& sign) const {
  return seconds(Duration(now() - sign));
}

std::string Health::why_dead() const {
  const double silence = seconds_since(timer_);
  if (silence <= seconds(kTimerLimit)) return "";
  return absl::StrFormat("the timer thread has been stuck for %.0f s", silence);
}

std::string Health::why_unready() const {
  if (std::string reason = why_dead(); !reason.empty()) return reason;
  if (!is_accepting_) return "the server does not accept calls";
  const double silence = seconds_since(writer_);
  if (silence > seconds(kWriterLimit)) {
    return absl::StrFormat("the writer thread has been stuck for %.0f s", silence);
  }
  const std::int64_t free = free_bytes_;
  if (free < kMinFreeBytes) {
    return absl::StrFormat("the disk of the store is full: %d MiB are free", free >> 20);
  }
  return has_paused_jobs_ ? "jobs are paused because the disk of the store is full" : "";
}

}  // namespace tessera::server
