#pragma once

#include <string>

#include "absl/status/status.h"

namespace tessera::server {

/// Whether a worker that shows this contract and this hash of the built-in reference tile (32
/// bytes) computes the bits of our own contract.
///
/// Errors: FailedPrecondition, another contract or hash (both sides' are named); InvalidArgument,
/// the hash is not 32 bytes.
absl::Status check_numerics(int contract_version, const std::string& numerics_sha256);

}  // namespace tessera::server
