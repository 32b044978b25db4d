#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera::render {

/// Index of the element of `names` that equals `wanted`, or else has it as its index. Errors:
/// InvalidArgument naming `kind` and the choices.
absl::StatusOr<std::int32_t> choose(const std::vector<std::string>& names,
                                    const std::string& wanted, const std::string& kind);

}  // namespace tessera::render
