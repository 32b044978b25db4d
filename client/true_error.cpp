#include "client/true_error.h"

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "client/frame_files.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

/// A folder of our own that goes with its contents.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code error;
    std::string name = (std::filesystem::temp_directory_path(error) / "tessera.XXXXXX").string();
    if (!error && ::mkdtemp(name.data()) != nullptr) path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

std::vector<std::int32_t> frames_of(const ordered_json& report) {
  std::vector<std::int32_t> frames;
  for (const ordered_json& frame : report.value("frames", ordered_json::array())) {
    frames.push_back(frame.value("frame", 0));
  }
  return frames;
}

}  // namespace

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
                             const std::string& reference, ordered_json& report) {
  const auto references = read_references(reference, frames_of(report));
  if (!references.ok()) return references.status();
  const ScratchFolder folder;
  if (folder.path().empty()) return absl::UnavailableError("no folder for temporary files");
  for (std::size_t i = 0; i < references->size(); ++i) {
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
        image->view(), (*references)[i].view(),
        m != frame.end() && m->is_number() ? std::optional(m->get<double>()) : std::nullopt);
    if (!difference.ok()) return difference.status();
    const ordered_json error =
        difference->error ? ordered_json(*difference->error) : ordered_json(nullptr);
    frame["true"] = {{"rmse", difference->rmse},
                     {"relmse", difference->relmse},
                     {"error", error},
                     {"flip", difference->flip}};
    if (!frame["curve"].empty()) frame["curve"].back()["error_true"] = error;
  }
  return absl::OkStatus();
}

}  // namespace tessera::client
