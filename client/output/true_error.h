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

/// The numbers of a report's frames, in its order.
std::vector<std::int32_t> frames_of(const nlohmann::ordered_json& report);

/// The size of a job's frames, and the part of them that its images show.
struct Window {
  std::int32_t width = 0, height = 0;
  contract::PixelRect rect;
};
/// The whole frame if the report has no crop within it.
Window window_of(const nlohmann::ordered_json& report);

/// References for frames: REF itself for one frame, else REF with each frame's number put in, as
/// `render` names its files. In the order of `frames`, all of the window's size: what REF, where it
/// is of the whole frame, has outside is left out.
///
/// Errors: those of read_image; InvalidArgument, one has another size or is not finite.
absl::StatusOr<std::vector<Image>> read_references(const std::string& path,
                                                   const std::vector<std::int32_t>& frames,
                                                   const Window& window);

/// Fills in what the frames of a finished job's report truly differ from `references` by, one for
/// each: `true`, and `error_true` of its curve's last point. Fetches the frames into a private
/// folder.
///
/// Errors: InvalidArgument, an image and its reference cannot be compared; those of fetch_frame.
absl::Status add_true_errors(FarmClient& client, const std::string& job_id,
                             const std::vector<Image>& references, nlohmann::ordered_json& report);

}  // namespace tessera::client
