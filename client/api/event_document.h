#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// Returns the name of a kind, e.g. "job submitted" for KIND_JOB_SUBMITTED.
std::string event_name(v1::Event::Kind kind);

/// Returns the names of all kinds.
std::vector<std::string> event_names();

/// Returns the server's time of an event: ISO 8601, UTC, with milliseconds.
std::string event_time_text(const v1::Event& event);

/// Returns the event as a document of schema tessera.event/1 (docs/reference/schema/event.json).
nlohmann::ordered_json event_document(const v1::Event& event);

}  // namespace tessera::client
