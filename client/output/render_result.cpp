#include "client/output/render_result.h"

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>

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

std::string result_line(const nlohmann::ordered_json& report, double wall_seconds) {
  const auto frames = report.value("frames", nlohmann::ordered_json::array());
  if (frames.empty()) return "no frame";
  double samples = 0;
  std::optional<double> error, upper;
  for (const auto& frame : frames) {
    samples += frame.value("samples", 0.0);
    const auto estimated = frame.value("estimated", nlohmann::ordered_json::object());
    if (!estimated.is_object() || !estimated.contains("error") || !estimated["error"].is_number()) {
      continue;
    }
    error = std::max(error.value_or(0), estimated["error"].get<double>());
    upper = std::max(upper.value_or(0), estimated.value("error_upper95", 0.0));
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
    const bool is_bounded = error && status != "UNCERTAIN";  // which claims nothing
    if (is_bounded) absl::StrAppend(&line, absl::StrFormat(", at most %.4g with 95 %%", *upper));
    absl::StrAppend(&line, ", ", status);
  }
  return absl::StrCat(line, ", ", format_seconds(wall_seconds));
}

std::string doubt_lines(const nlohmann::ordered_json& report, std::span<const std::string> said) {
  std::string lines;
  for (const char* list : {"reasons", "warnings"}) {
    for (const auto& doubt : report.value(list, nlohmann::ordered_json::array())) {
      if (!doubt.is_string()) continue;
      const auto text = doubt.get<std::string>();
      if (std::find(said.begin(), said.end(), text) != said.end()) continue;
      absl::StrAppend(&lines, "tessera: ", text, "\n");
    }
  }
  return lines;
}

}  // namespace tessera::client
