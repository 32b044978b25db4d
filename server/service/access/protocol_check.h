#pragma once

#include <string>

#include "absl/status/status.h"

namespace tessera::server {

/// Checks that this server understands the protocol version of a caller. `program` names the caller
/// in the message, such as "worker".
///
/// Errors: FailedPrecondition, the version is too old or too new; the message names both sides'
/// versions and what to upgrade.
absl::Status check_protocol(const std::string& program, int protocol_version);

}  // namespace tessera::server
