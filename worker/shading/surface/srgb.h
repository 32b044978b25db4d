#pragma once

#include <array>
#include <vector>

namespace tessera::render {

/// Linear value of an sRGB-encoded one in [0, 1], correctly rounded but for the odd last bit of
/// a double: ((c + 0.055) / 1.055)^2.4 above 0.04045, c / 12.92 below. Exactly rounded operations
/// only. Source: IEC 61966-2-1.
double srgb_to_linear(double encoded);

/// The 256 codes of 8-bit sRGB, as floats within 1 ulp.
std::array<float, 256> srgb8_table();
/// The 65,536 codes of 16-bit sRGB.
std::vector<float> srgb16_table();

}  // namespace tessera::render
