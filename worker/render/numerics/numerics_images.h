#pragma once

#include <cstddef>
#include <span>

namespace tessera::render {

/// Image files of the reference tile, made with oiiotool from noise. Their decoded pixels are part
/// of the numerics digest, so changing them changes the digest.
std::span<const std::byte> numerics_png();   // 16 x 16, 8-bit RGB
std::span<const std::byte> numerics_jpeg();  // 32 x 32, quality 85, 4:2:0
std::span<const std::byte> numerics_exr();   // 16 x 8, half RGB, ZIP

}  // namespace tessera::render
