#include "client/api/event_document.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/time/time.h"

namespace tessera::client {

std::string event_name(v1::Event::Kind kind) {
  std::string name = absl::AsciiStrToLower(v1::Event::Kind_Name(kind));
  name.erase(0, std::min(name.size(), sizeof "kind_" - 1));
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::vector<std::string> event_names() {
  std::vector<std::string> names;
  for (int kind = v1::Event::KIND_UNSPECIFIED + 1; kind <= v1::Event::Kind_MAX; ++kind) {
    names.push_back(event_name(static_cast<v1::Event::Kind>(kind)));
  }
  return names;
}

std::string event_time_text(const v1::Event& event) {
  const absl::Time time = absl::FromUnixSeconds(event.event_time().seconds()) +
                          absl::Nanoseconds(event.event_time().nanos());
  return absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", time, absl::UTCTimeZone());
}

nlohmann::ordered_json event_document(const v1::Event& event) {
  return {{"schema", "tessera.event/1"},    {"sequence", event.sequence()},
          {"time", event_time_text(event)}, {"kind", event_name(event.kind())},
          {"job", event.job_id()},          {"worker", event.worker_id()},
          {"message", event.message()}};
}

}  // namespace tessera::client
