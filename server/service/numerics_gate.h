#pragma once

#include <mutex>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "proto/contract/digest.h"

namespace tessera::server {

/// Lets only workers in that compute the same bits: same render contract, same hash of the built-in
/// reference tile. The store's first worker sets the hash; it is kept in a file beside the store,
/// for its contract version. Thread-safe.
class NumericsGate {
 public:
  /// `path`: where the hash is kept.
  explicit NumericsGate(std::string path);

  /// Errors: FailedPrecondition, another contract or hash (both are named); InvalidArgument, the
  /// hash is not 32 bytes.
  absl::Status check(int contract_version, const std::string& numerics_sha256);

 private:
  const std::string path_;
  std::mutex mutex_;
  std::optional<contract::Digest> expected_;
};

}  // namespace tessera::server
