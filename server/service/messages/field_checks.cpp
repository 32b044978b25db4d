#include "server/service/messages/field_checks.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "telemetry/log/printable.h"

namespace tessera::server {
namespace {

bool is_name(const std::string& id) {
  constexpr char kAllowed[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
  return !id.empty() && id.size() <= kMaxIdLetters &&
         id.find_first_not_of(kAllowed) == std::string::npos;
}

}  // namespace

absl::Status bad(const std::string& field, const std::string& need) {
  return absl::InvalidArgumentError(absl::StrCat(field, ": ", need));
}

absl::Status check_text(const std::string& field, const std::string& text, std::size_t min,
                        std::size_t max) {
  if (has_control_characters(text)) return bad(field, "contains a control character");
  if (text.size() >= min && text.size() <= max) return absl::OkStatus();
  return bad(field, absl::StrCat("has ", text.size(), " characters, expected ", min, " to ", max));
}

absl::Status check_range(const std::string& field, std::int64_t value, std::int64_t low,
                         std::int64_t high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return bad(field, absl::StrCat(value, " is not in [", low, ", ", high, "]"));
}

absl::Status check_name(const std::string& field, const std::string& name) {
  if (is_name(name)) return absl::OkStatus();
  return bad(field, "expected 1 to 64 characters of [a-zA-Z0-9._-]");
}

void set_duration(double span_seconds, google::protobuf::Duration& duration) {
  const double clamped = std::min(std::max(span_seconds, 0.0), 1e9);
  duration.set_seconds(static_cast<std::int64_t>(clamped));
  duration.set_nanos(static_cast<std::int32_t>((clamped - std::floor(clamped)) * 1e9));
}

void set_time(std::int64_t time_us, google::protobuf::Timestamp& timestamp) {
  timestamp.set_seconds(time_us / 1'000'000);
  timestamp.set_nanos(static_cast<std::int32_t>(time_us % 1'000'000 * 1000));
}

}  // namespace tessera::server
