#pragma once

#include <vector>

#include "cli/version_text.h"

namespace tessera::image {

/// Versions of the libraries that read and write images.
std::vector<cli::LibraryVersion> library_versions();

}  // namespace tessera::image
