#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera::server {

/// The fact that a worker joined with a token.
struct Join {
  std::string worker_id;
  std::string token_id;
  std::string certificate;  // name in the worker's certificate
};

/// The workers that a restarted server must know: the roster of those that are connected, bans, and
/// joins with tokens. One thread at a time may call writing functions, that of Store; any thread
/// may call reading functions.
class WorkerStore {
 public:
  virtual ~WorkerStore() = default;

  virtual absl::Status add_worker(const std::string& worker_id, const std::string& name) = 0;
  virtual absl::Status remove_worker(const std::string& worker_id) = 0;
  virtual absl::StatusOr<std::vector<std::string>> roster() const = 0;
  /// Bans and lifts bans; durable on return. Idempotent.
  virtual absl::Status ban_worker(const std::string& worker_id) = 0;
  virtual absl::Status allow_worker(const std::string& worker_id) = 0;
  virtual absl::StatusOr<std::vector<std::string>> banned_workers() const = 0;

  /// Records that a worker joined with a token, once per worker and token; durable on return.
  ///
  /// Errors: PermissionDenied, `max_joins` other workers have joined with the token (0: unlimited),
  /// or a worker with this ID joined with another certificate.
  virtual absl::Status record_join(const Join& join, std::int64_t max_joins) = 0;
  /// Removes joins of workers that are not in the roster and have not connected since
  /// `unseen_since_us`, except joins with a token in `valid`, which count towards its limit.
  virtual absl::Status remove_stale_joins(const std::vector<std::string>& valid,
                                          std::int64_t unseen_since_us) = 0;
};

}  // namespace tessera::server
