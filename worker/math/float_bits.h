#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

namespace tessera::render {

/// The next float above x; -0 counts as 0. The largest float gives +inf. Requires finite x.
inline float next_up(float x) {
  if (x == 0) return std::bit_cast<float>(std::uint32_t{1});
  const auto bits = std::bit_cast<std::uint32_t>(x);
  return std::bit_cast<float>(x > 0 ? bits + 1 : bits - 1);
}

/// The next float below x, with the same rules.
inline float next_down(float x) {
  return -next_up(-x);
}

}  // namespace tessera::render
