#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// "job submitted" for KIND_JOB_SUBMITTED.
std::string event_name(v1::Event::Kind kind);

/// Names of all kinds.
std::vector<std::string> event_names();

/// When, by the server's clock: ISO 8601 with milliseconds, UTC.
std::string event_time_text(const v1::Event& event);

/// The event as programs get it (docs/reference/schema/event.json).
nlohmann::ordered_json event_document(const v1::Event& event);

}  // namespace tessera::client
