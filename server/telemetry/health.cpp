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
  if (silence <= seconds(kWriterLimit)) return "";
  return absl::StrFormat("the writer thread has been stuck for %.0f s", silence);
}

}  // namespace tessera::server
