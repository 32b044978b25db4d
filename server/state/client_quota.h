#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Upper bounds of what a job needs.
struct JobSize {
  std::int64_t store_bytes = 0;  // blocks of all frames, and the images
  double samples = 0;            // pixels × samples, over all frames
};
JobSize max_job_size(const JobSpec& spec);

/// Limits of the sum over an owner's unfinished jobs. 0: unlimited.
struct ClientQuota {
  std::int64_t jobs = 0;
  std::int64_t store_bytes = 0;
  double samples = 0;
  bool has_limits() const { return jobs > 0 || store_bytes > 0 || samples > 0; }
};

/// Sum over an owner's unfinished jobs.
struct OwnerUse {
  std::int64_t jobs = 0;
  double store_bytes = 0, samples = 0;
  void add(const JobSpec& spec);
};

/// Checks that an owner with this use may have another job. Errors: ResourceExhausted, with the
/// limit and the total.
absl::Status check_quota(const ClientQuota& quota, OwnerUse use, const JobSpec& spec);

}  // namespace tessera::server
