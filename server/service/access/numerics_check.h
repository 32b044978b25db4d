#pragma once

#include <string>

#include "absl/status/status.h"

namespace tessera::server {

/// Checks that a worker with this contract and this hash of the built-in reference tile (32 bytes)
/// computes the bits of the server's contract.
///
/// Errors: FailedPrecondition, another contract or hash (the message has both sides');
/// InvalidArgument, the hash is not 32 bytes long.
absl::Status check_numerics(int contract_version, const std::string& numerics_sha256);

}  // namespace tessera::server
