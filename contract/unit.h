#pragma once

#include <compare>
#include <cstdint>

namespace tessera::contract {

/// A unit of work within its job: the key by which results commit.
struct Unit {
  std::int32_t frame = 0;  // frame number
  std::int32_t tile = 0;   // index along the Hilbert curve
  std::int32_t pass = 0;
  auto operator<=>(const Unit&) const = default;
};

}  // namespace tessera::contract
