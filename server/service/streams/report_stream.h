#pragma once

#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "server/service/access/access.h"
#include "server/sync/io_pool.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// Returns a reactor that sends a job's report in parts (JobService.GetJobReport); it deletes
/// itself. `caller` holds a place in the stream limit until the end; if it is an error, the stream
/// ends at once. `read` returns the report as UTF-8; it reads the disk, so it runs on the pool.
grpc::ServerWriteReactor<v1::GetJobReportResponse>* send_report(
    IoPool& io, const absl::StatusOr<Caller>& caller,
    std::function<absl::StatusOr<std::string>()> read);

}  // namespace tessera::server
