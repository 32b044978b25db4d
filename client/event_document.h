#pragma once

#include <string>

#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// "job submitted" for KIND_JOB_SUBMITTED.
std::string event_name(v1::Event::Kind kind);

}  // namespace tessera::client
