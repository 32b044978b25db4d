#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "server/schedule/plan/job_spec.h"
#include "server/schedule/workers/worker.h"
#include "server/store/store.h"

namespace tessera::server {

/// CPU time of each unit; exact in binary, so that sums are.
inline constexpr double kUnitSeconds = 0.5;

/// Kinds of small jobs, which differ in size, frames and passes.
inline constexpr int kJobKinds = 4;
/// Kinds of jobs of a farm that three owners share: two large ones, whose sizes are as their
/// owners' weights, and one of low priority.
inline constexpr int kFirstSharedKind = 4, kSharedKinds = 3;
/// The weight of the owner of the first of them; others have 1.
inline constexpr double kFirstWeight = 4;

/// Returns a new job of a kind, without IDs.
JobSpec small_job(int kind, int sample_count);
/// The same from its row. Errors: DataLoss.
absl::StatusOr<JobSpec> small_job(const JobRecord& record);
/// Returns the request from which small_job() makes `spec`.
std::string request_of(const JobSpec& spec);
/// Returns the kind of a job.
int kind_of(const JobSpec& spec);

/// Returns the bytes and the digest of the scene of a kind.
std::string scene_bytes(int kind);
contract::Digest scene_of(int kind);

/// Returns the encoded block of a unit. It depends on nothing else.
std::string block_of(const JobSpec& spec, const contract::Unit& unit, int sample_count);

/// Returns the digests of the frames' pixels, from a film that gets the blocks in order.
std::vector<std::string> undisturbed_pixels(int kind, int sample_count);

}  // namespace tessera::server
