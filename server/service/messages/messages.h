#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "tessera/v1/job_service.pb.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::server {

// Messages to and from the coordinator's plain structs. Everything that comes from outside is
// checked here: ranges, lengths, digests. Errors are InvalidArgument, "field: value, what it
// needs".

/// What a client asked for. `owner` is whoever the server takes it for.
absl::StatusOr<JobSpec> to_spec(const v1::CreateJobRequest& request, const std::string& owner);

/// A job's spec from its row. Errors: DataLoss, the row does not parse.
absl::StatusOr<JobSpec> read_spec(const JobRecord& record);

/// The request of `spec`, serialised, with the sample count and error that `spec` has now.
std::string write_request(const JobSpec& spec);

v1::Job to_message(const JobView& view);
v1::SceneManifest to_manifest(const JobSpec& spec);
v1::Event to_message(const Event& event);
v1::Delivery to_message(const Delivery& delivery);
v1::Worker to_message(const Worker& worker, double silence_seconds);
v1::UnitId to_message(const UnitName& name);
v1::Lease to_message(const Lease& lease);
v1::Acknowledgement to_message(const Acknowledgement& acknowledgement);
v1::FrameHeader to_message(const FrameFile& file);

UnitName from_message(const v1::UnitId& message);
/// A lease as it came; whether it is ours, its seal tells.
Lease from_message(const v1::Lease& message);
absl::StatusOr<Hello> from_message(const v1::WorkerHello& message);
absl::StatusOr<BlockHeader> from_message(const v1::BlockHeader& message);
absl::StatusOr<FrameQuery> from_message(const v1::FetchFrameRequest& message);

}  // namespace tessera::server
