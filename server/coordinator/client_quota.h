#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "server/schedule/job_spec.h"

namespace tessera::server {

/// What a job may come to at most.
struct JobSize {
  std::int64_t store_bytes = 0;  // blocks of every frame, and the images
  double samples = 0;            // pixels × samples, over its frames
};
JobSize size_of(const JobSpec& spec);

/// Limits of one owner's jobs that have not ended, taken together. 0: no limit.
struct ClientQuota {
  std::int64_t jobs = 0;
  std::int64_t store_bytes = 0;
  double samples = 0;
  bool has_limits() const { return jobs > 0 || store_bytes > 0 || samples > 0; }
};

/// What an owner has of that.
struct OwnerUse {
  std::int64_t jobs = 0;
  double store_bytes = 0, samples = 0;
  void add(const JobSpec& spec);
};

/// Whether an owner who uses so much may have this job too. Errors: ResourceExhausted, naming the
/// limit and what it would come to.
absl::Status check_quota(const ClientQuota& quota, OwnerUse use, const JobSpec& spec);

}  // namespace tessera::server
