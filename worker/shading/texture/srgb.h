#pragma once

#include <array>
#include <vector>

namespace tessera::render {

/// Linear value of an sRGB-encoded value in [0, 1]: ((c + 0.055) / 1.055)^2.4 above 0.04045, c /
/// 12.92 below. Accurate to about the last bit of a double, using exactly rounded operations only.
/// Source: IEC 61966-2-1.
double srgb_to_linear(double encoded);

/// Linear values of the 256 codes of 8-bit sRGB, as floats within 1 ulp.
std::array<float, 256> srgb8_table();
/// Linear values of the 65,536 codes of 16-bit sRGB.
std::vector<float> srgb16_table();

}  // namespace tessera::render
