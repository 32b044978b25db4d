#include "server/film/frame_summary.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "contract/pass_schedule.h"

namespace tessera::server {

using nlohmann::json;

bool FrameSummary::fits(const contract::RenderSettings& settings) const {
  return spp == contract::rounded_spp(settings.spp) && error == settings.error;
}

std::string write_frame_summary(const FrameSummary& summary) {
  json document = {{"spp", summary.spp},
                   {"samples", summary.samples},
                   {"units", summary.unit_count},
                   {"warnings", summary.warnings},
                   {"reasons", summary.reasons}};
  if (summary.error) document["error"] = *summary.error;
  if (summary.estimated_error) document["estimated_error"] = *summary.estimated_error;
  if (!summary.doubts.empty()) document["doubts"] = summary.doubts;
  if (summary.certainty) document["certainty"] = certainty_name(*summary.certainty);
  std::string text = document.dump();
  text.pop_back();  // the entry is JSON already
  return absl::StrCat(text, R"(,"entry":)", summary.entry_json.empty() ? "{}" : summary.entry_json,
                      "}");
}

FrameSummary read_frame_summary(const std::string& text) {
  FrameSummary summary;
  const json document = json::parse(text, nullptr, false);
  if (!document.is_object()) return summary;
  summary.spp = document.value("spp", 0);
  summary.samples = document.value("samples", std::int64_t{0});
  summary.unit_count = document.value("units", std::int64_t{0});
  summary.warnings = document.value("warnings", summary.warnings);
  summary.reasons = document.value("reasons", summary.reasons);
  summary.entry_json = document.value("entry", json::object()).dump();
  if (document.contains("error")) summary.error = document["error"].get<double>();
  if (document.contains("estimated_error")) {
    summary.estimated_error = document["estimated_error"].get<double>();
  }
  summary.doubts = document.value("doubts", summary.doubts);
  if (document.contains("certainty")) {
    summary.certainty = parse_certainty(document["certainty"].get<std::string>());
  }
  return summary;
}

}  // namespace tessera::server
