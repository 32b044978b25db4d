#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::server {

enum class ExportFormat : std::uint8_t { png, jpeg };

/// Converts a frame's EXR file for display and returns the bytes of a PNG (8 bits, RGBA, not
/// premultiplied) or JPEG (8 bits, over black).
///
/// Each channel is linear · 2^exposure_ev, clipped to [0, 1] and sRGB encoded; the window is the
/// file's dataWindow. Works in bands of scanlines; memory is one band and the result.
///
/// Errors: NotFound, no such file; DataLoss, it is not a readable frame of Tessera; Internal, the
/// encoder failed (the messages say why).
absl::StatusOr<std::string> export_image(const std::string& exr_path, ExportFormat format,
                                         double exposure_ev);

}  // namespace tessera::server
