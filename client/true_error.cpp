#include "client/true_error.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/frame_files.h"
#include "client/private_folder.h"

namespace tessera::client {

using nlohmann::ordered_json;

std::vector<std::int32_t> frames_of(const ordered_json& report) {
  std::vector<std::int32_t> frames;
  for (const ordered_json& frame : report.value("frames", ordered_json::array())) {
    frames.push_back(frame.value("frame", 0));
  }
  return frames;
}

absl::StatusOr<std::vector<Image>> read_references(const std::string& path,
                                                   const std::vector<std::int32_t>& frames) {
  std::vector<Image> images;
  for (const std::int32_t frame : frames) {
    auto image = read_image(frames.size() == 1 ? path : with_frame_number(path, frame));
    if (!image.ok()) return image.status();
    images.push_back(*std::move(image));
  }
  return images;
}

absl::Status add_true_errors(FarmClient& client, const std::string& job_id,
                             const std::vector<Image>& references, ordered_json& report) {
  const PrivateFolder folder;
  if (folder.path().empty()) {
    return absl::UnavailableError("no private folder can be made in TMPDIR or /tmp");
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
    // The farm tells it after each round where it was given the reference with the job.
    if (!frame["curve"].empty()) frame["curve"].back()["error_true"] = error;
  }
  return absl::OkStatus();
}

}  // namespace tessera::client
