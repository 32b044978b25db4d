#pragma once

#include <google/protobuf/duration.pb.h>
#include <google/protobuf/timestamp.pb.h>

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"

namespace tessera::server {

// Checks of fields of messages, and values that several messages have. Errors: InvalidArgument,
// "field: value, requirement".

/// Maximum length of IDs and of names.
inline constexpr std::size_t kMaxIdLetters = 64, kMaxNameLetters = 200;

/// Returns the error "field: need".
absl::Status bad(const std::string& field, const std::string& need);

/// Checks a text that is shown or stored as it is: its length in bytes, no control characters.
absl::Status check_text(const std::string& field, const std::string& text, std::size_t min,
                        std::size_t max);

absl::Status check_range(const std::string& field, std::int64_t value, std::int64_t low,
                         std::int64_t high);

/// Checks the name of a client, a pool, a limit, a project or a worker: 1 to 64 of [a-zA-Z0-9._-].
absl::Status check_name(const std::string& field, const std::string& name);

void set_duration(double span_seconds, google::protobuf::Duration& duration);
void set_time(std::int64_t time_us, google::protobuf::Timestamp& timestamp);

}  // namespace tessera::server
