#pragma once

#include <string>

#include "server/report/job_view.h"

namespace tessera::server {

/// The report of a job so far as JSON, schema tessera.report/1: every key of design.md, section 4.
/// What this version does not measure is null or empty, never invented.
std::string report_json(const JobReport& report);

}  // namespace tessera::server
