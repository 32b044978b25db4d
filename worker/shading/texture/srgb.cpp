#include "worker/shading/texture/srgb.h"

#include <cstddef>

namespace tessera::render {
namespace {

/// a^(1/5) for a in (0, 1] by Newton's iteration, which decreases monotonically from above.
double fifth_root(double a) {
  double y = 1;
  for (;;) {
    const double y4 = (y * y) * (y * y);
    const double next = y - (y - a / y4) / 5;
    if (!(next < y)) return y;
    y = next;
  }
}

}  // namespace

double srgb_to_linear(double encoded) {
  if (encoded <= 0.04045) return encoded / 12.92;
  const double x = (encoded + 0.055) / 1.055;
  const double x2 = x * x;
  return x2 * fifth_root(x2);
}

std::array<float, 256> srgb8_table() {
  std::array<float, 256> table{};
  for (std::size_t i = 0; i < table.size(); ++i) {
    table[i] = static_cast<float>(srgb_to_linear(static_cast<double>(i) / 255));
  }
  return table;
}

std::vector<float> srgb16_table() {
  std::vector<float> table(65536);
  for (std::size_t i = 0; i < table.size(); ++i) {
    table[i] = static_cast<float>(srgb_to_linear(static_cast<double>(i) / 65535));
  }
  return table;
}

}  // namespace tessera::render
