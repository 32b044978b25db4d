#pragma once

#include <string>
#include <vector>

namespace tessera::client {

/// Writes an image; the extension of `path` chooses the format, 8 bits for .png and float
/// otherwise. In a file of its own, because OpenImageIO's headers undefine macros that protobuf's
/// headers need.
void write_image(const std::string& path, int width, int height, int channels,
                 const std::vector<float>& pixels);

}  // namespace tessera::client
