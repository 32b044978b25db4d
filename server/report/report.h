#pragma once

#include <string>

#include "server/report/job_view.h"

namespace tessera::server {

/// Returns the report of a job so far as JSON (docs/reference/schema/report.json). Figures that
/// this version does not measure are null or empty.
std::string report_json(const JobReport& report);

}  // namespace tessera::server
