#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// Parses NAME or NAME=AMOUNT, one for each limit; without AMOUNT 1. Errors: InvalidArgument.
absl::StatusOr<v1::LimitUses> parse_limit_uses(const std::vector<std::string>& texts);

}  // namespace tessera::client
