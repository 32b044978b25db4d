#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/service/access/access.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// Returns a reactor that sends a job's report in parts (JobService.GetJobReport); it deletes
/// itself. `caller` holds a place in the stream limit until the end. `report`: UTF-8, or the status
/// with which the stream ends at once.
grpc::ServerWriteReactor<v1::GetJobReportResponse>* send_report(
    const absl::StatusOr<Caller>& caller, absl::StatusOr<std::string> report);

}  // namespace tessera::server
