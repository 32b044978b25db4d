#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace tessera::render {

/// cos and sin of (k + 1/2) pi / kCount, k in [0, kCount), from cos(pi / 4) by half-angle and
/// addition formulas. Uses exactly rounded operations only, for tables that must be identical on
/// all machines. kCount is a power of two, at least 2.
template <std::size_t kCount>
struct HalfCircle {
  std::array<double, kCount> cosine{}, sine{};

  HalfCircle() {
    double c = std::sqrt(0.5);  // cos(pi / 4)
    for (std::size_t n = 4; n < 2 * kCount; n *= 2) c = std::sqrt((1 + c) / 2);
    const double s = std::sqrt((1 - c) * (1 + c));  // angle pi / (2 kCount)
    const double c2 = (c - s) * (c + s), s2 = 2 * c * s;
    cosine[0] = c;
    sine[0] = s;
    for (std::size_t k = 1; k < kCount; ++k) {
      cosine[k] = cosine[k - 1] * c2 - sine[k - 1] * s2;
      sine[k] = sine[k - 1] * c2 + cosine[k - 1] * s2;
    }
  }
};

}  // namespace tessera::render
