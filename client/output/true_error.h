#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/api/farm_client.h"
#include "client/output/image_file.h"
#include "contract/render_settings.h"

namespace tessera::client {

/// Returns the frame numbers of a report, in its order.
std::vector<std::int32_t> frames_of(const nlohmann::ordered_json& report);

/// Size of a job's frames and the rectangle that its images show.
struct Window {
  std::int32_t width = 0, height = 0;
  contract::PixelRect rect;
};
/// Returns the window of a report; without a crop, the whole frame.
Window window_of(const nlohmann::ordered_json& report);

/// Reads the reference images: `path` itself for one frame, else `path` with each frame number
/// inserted, as `render` names its files. Returns them in the order of `frames`, cropped to the
/// window.
///
/// Errors: those of read_image; InvalidArgument, the size of an image does not match or a value is
/// not finite.
absl::StatusOr<std::vector<Image>> read_references(const std::string& path,
                                                   const std::vector<std::int32_t>& frames,
                                                   const Window& window);

/// Adds each frame's measured error against its reference to the report of a finished job: `true`,
/// and `error_true` of the last point of the curve. Downloads the frames to a private directory.
///
/// Errors: InvalidArgument, an image and its reference cannot be compared; those of fetch_frame.
absl::Status add_true_errors(FarmClient& client, const std::string& job_id,
                             const std::vector<Image>& references, nlohmann::ordered_json& report);

}  // namespace tessera::client
