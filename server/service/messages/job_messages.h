#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "tessera/v1/job_service.pb.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::server {

// Converts requests about jobs to the coordinator's plain structs and jobs to messages. All
// external input is checked here: ranges, lengths, digests. Errors: InvalidArgument, "field: value,
// requirement".

/// Converts a request to a job's spec for `owner`.
absl::StatusOr<JobSpec> to_spec(const v1::CreateJobRequest& request, const std::string& owner);

absl::StatusOr<JobAdmin::Update> from_message(const v1::UpdateJobRequest& message);

absl::StatusOr<JobFilter> to_filter(const v1::ListJobsRequest& request);

/// Parses a job's spec from its row. Errors: DataLoss.
absl::StatusOr<JobSpec> read_spec(const JobRecord& record);

/// Serialises the request of `spec` with what may change after its creation.
std::string write_request(const JobSpec& spec);

v1::FailedAttempt to_message(const FailedAttempt& attempt);
v1::Job to_message(const JobView& view);
v1::SceneManifest to_manifest(const JobSpec& spec);
v1::JobDescription describe(const JobSpec& spec);

}  // namespace tessera::server
