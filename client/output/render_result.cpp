#include "client/output/render_result.h"

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/progress.h"

namespace tessera::client {

void name_files(nlohmann::ordered_json& report, const std::vector<std::string>& files) {
  if (!report.contains("frames") || !report["frames"].is_array()) return;
  auto& frames = report["frames"];
  for (std::size_t i = 0; i < std::min(frames.size(), files.size()); ++i) {
    frames[i]["file"] = files[i];
  }
}

namespace {

/// Error and bound of a frame: of the denoised image if there is one.
struct FrameError {
  std::optional<double> error;
  double upper = 0;
};

FrameError error_of(const nlohmann::ordered_json& frame) {
  for (const auto& [object, error, upper] :
       {std::tuple("denoised", "error_denoised", "error_denoised_upper95"),
        std::tuple("estimated", "error", "error_upper95")}) {
    const auto found = frame.find(object);
    if (found == frame.end() || !found->is_object()) continue;
    const auto value = found->find(error);
    if (value == found->end() || !value->is_number()) continue;
    return {value->get<double>(), found->value(upper, 0.0)};
  }
  return {};
}

}  // namespace

std::string result_line(const nlohmann::ordered_json& report, double wall_seconds) {
  const auto frames = report.value("frames", nlohmann::ordered_json::array());
  if (frames.empty()) return "no frames";
  double samples = 0;
  std::optional<double> error, upper;
  for (const auto& frame : frames) {
    samples += frame.value("samples", 0.0);
    const FrameError of_frame = error_of(frame);
    if (!of_frame.error) continue;
    error = std::max(error.value_or(0), *of_frame.error);
    upper = std::max(upper.value_or(0), of_frame.upper);
  }
  const auto& first = frames.front();
  std::string line = first.value("file", "");
  if (frames.size() > 1) absl::StrAppend(&line, " … ", frames.back().value("file", ""));
  absl::StrAppend(&line, ": ", first.value("width", 0), "x", first.value("height", 0), ", ",
                  format_count(samples), " samples");
  if (error) absl::StrAppend(&line, ", estimated error ", absl::StrFormat("%.4g", *error));
  const std::string status = report.value("status", "");
  for (const char* certainty : {"CONVERGED", "CAPPED", "UNCERTAIN"}) {
    if (status != certainty) continue;
    const bool is_bounded = error && status != "UNCERTAIN";
    if (is_bounded) absl::StrAppend(&line, absl::StrFormat(", ≤ %.4g at 95 %% confidence", *upper));
    absl::StrAppend(&line, ", ", status);
  }
  return absl::StrCat(line, ", ", format_seconds(wall_seconds));
}

std::string warning_lines(const nlohmann::ordered_json& report,
                          std::span<const std::string> already_printed) {
  std::string lines;
  for (const char* list : {"reasons", "warnings"}) {
    for (const auto& entry : report.value(list, nlohmann::ordered_json::array())) {
      if (!entry.is_string()) continue;
      const auto text = entry.get<std::string>();
      if (std::find(already_printed.begin(), already_printed.end(), text) != already_printed.end())
        continue;
      absl::StrAppend(&lines, "tessera: ", text, "\n");
    }
  }
  return lines;
}

}  // namespace tessera::client
