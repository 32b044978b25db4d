#pragma once

#include <string>
#include <vector>

namespace tessera::client {

/// Writes an image by the extension of `path`, 8 bits for .png, else float. Apart from the tests,
/// as OpenImageIO's headers take macros away that protobuf's need.
void write_image(const std::string& path, int width, int height, int channels,
                 const std::vector<float>& pixels);

}  // namespace tessera::client
