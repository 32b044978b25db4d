#include "client/output/true_error.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/local_farm/private_folder.h"
#include "client/output/frame_files.h"

namespace tessera::client {

using nlohmann::ordered_json;

namespace {

/// Returns the part `rect` of an image, which must contain it.
Image cut(const Image& image, const contract::PixelRect& rect) {
  Image part{rect.width, rect.height, {}};
  for (std::int32_t y = rect.y; y < rect.y + rect.height; ++y) {
    const auto row = image.rgba.begin() + 4 * (std::ptrdiff_t{y} * image.width + rect.x);
    part.rgba.insert(part.rgba.end(), row, row + 4 * std::ptrdiff_t{rect.width});
  }
  return part;
}

/// Reads a reference and crops it to the window. Checks everything that would make the comparison
/// at the end of the job fail.
absl::StatusOr<Image> read_reference(const std::string& path, const Window& window) {
  auto image = read_image(path);
  if (!image.ok()) return image.status();
  const contract::PixelRect& rect = window.rect;
  const bool is_whole = image->width == window.width && image->height == window.height;
  const bool is_part = image->width == rect.width && image->height == rect.height;
  if (!is_whole && !is_part) {
    const bool is_crop = rect.width != window.width || rect.height != window.height;
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": the reference is ", image->width, "x", image->height, "; expected ",
                     window.width, "x", window.height,
                     is_crop ? absl::StrCat(" or, cropped, ", rect.width, "x", rect.height) : ""));
  }
  if (!is_part) *image = cut(*image, rect);
  if (!std::all_of(image->rgba.begin(), image->rgba.end(),
                   [](float value) { return std::isfinite(value); })) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": the reference has values that are not finite; render it again"));
  }
  return image;
}

}  // namespace

std::vector<std::int32_t> frames_of(const ordered_json& report) {
  std::vector<std::int32_t> frames;
  for (const ordered_json& frame : report.value("frames", ordered_json::array())) {
    frames.push_back(frame.value("frame", 0));
  }
  return frames;
}

Window window_of(const ordered_json& report) {
  const ordered_json settings = report.value("settings", ordered_json::object());
  Window window{settings.value("width", 0), settings.value("height", 0), {}};
  const ordered_json crop = settings.value("crop", ordered_json());
  window.rect = {0, 0, window.width, window.height};
  if (!crop.is_array() || crop.size() != 4) return window;
  const contract::PixelRect rect{crop[0], crop[1], crop[2], crop[3]};
  if (rect.x >= 0 && rect.y >= 0 && rect.width > 0 && rect.height > 0 &&
      rect.x <= window.width - rect.width && rect.y <= window.height - rect.height) {
    window.rect = rect;
  }
  return window;
}

absl::StatusOr<std::vector<Image>> read_references(const std::string& path,
                                                   const std::vector<std::int32_t>& frames,
                                                   const Window& window) {
  std::vector<Image> images;
  for (const std::int32_t frame : frames) {
    auto image = read_reference(frames.size() == 1 ? path : with_frame_number(path, frame), window);
    if (!image.ok()) return image.status();
    images.push_back(*std::move(image));
  }
  return images;
}

absl::Status add_true_errors(FarmClient& client, const std::string& job_id,
                             const std::vector<Image>& references, ordered_json& report) {
  const PrivateFolder folder;
  if (folder.path().empty()) {
    return absl::UnavailableError("cannot create a private directory in TMPDIR or /tmp");
  }
  for (std::size_t i = 0; i < references.size(); ++i) {
    ordered_json& frame = report["frames"][i];
    FrameFile file;
    file.job_id = job_id;
    file.frame = frame.value("frame", 0);
    file.path = absl::StrCat(folder.path(), "/", i, ".exr");
    const auto fetched = fetch_frame_file(client, file);
    if (!fetched.ok()) return fetched.status();
    if (!fetched->unfinished.empty()) continue;
    const auto image = read_image(file.path);
    if (!image.ok()) return image.status();
    const auto m = frame.find("mean_luminance");
    const auto difference = contract::compare_images(
        image->view(), references[i].view(),
        m != frame.end() && m->is_number() ? std::optional(m->get<double>()) : std::nullopt);
    if (!difference.ok()) return difference.status();
    const ordered_json error =
        difference->error ? ordered_json(*difference->error) : ordered_json(nullptr);
    frame["true"] = {{"rmse", difference->rmse},
                     {"relmse", difference->relmse},
                     {"error", error},
                     {"flip", difference->flip}};
    // If the reference was submitted with the job, the server has added the error of each pass.
    if (!frame["curve"].empty()) frame["curve"].back()["error_true"] = error;
  }
  return absl::OkStatus();
}

}  // namespace tessera::client
