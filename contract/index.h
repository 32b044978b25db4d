#pragma once

#include <cstddef>
#include <cstdint>

namespace tessera::contract {

/// Converts a position or a count, never negative, to the type of the standard containers.
constexpr std::size_t as_index(std::int64_t position) {
  return static_cast<std::size_t>(position);
}

}  // namespace tessera::contract
