#include "server/report/report.h"

#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "contract/pass_schedule.h"
#include "contract/version.h"
#include "server/film/frame_summary.h"

namespace tessera::server {
namespace {

using nlohmann::json;

std::string scene_sha256(const JobSpec& spec) {
  std::vector<contract::Digest> digests;
  for (const ManifestEntry& entry : spec.assets) digests.push_back(entry.digest);
  return contract::sha256_of_set(std::move(digests)).hex();
}

const char* filter_name(contract::PixelFilter filter) {
  switch (filter) {
    case contract::PixelFilter::gaussian:
      return "gaussian";
    case contract::PixelFilter::blackman_harris:
      return "blackman-harris";
    case contract::PixelFilter::box:
      break;
  }
  return "box";
}

json background_json(const contract::RenderSettings& settings) {
  if (settings.background == contract::Background::none) return "none";
  if (settings.background == contract::Background::automatic) return "environment";
  return settings.background_color;
}

json settings_json(const contract::RenderSettings& s) {
  json frames = json::array();
  for (const contract::FrameRange& range : s.frames) {
    frames.push_back({{"first", range.first}, {"last", range.last}, {"step", range.step}});
  }
  json crop = nullptr;
  if (s.crop) crop = {s.crop->x, s.crop->y, s.crop->width, s.crop->height};
  json settings = {{"width", s.width},
                   {"height", s.height},
                   {"crop", crop},
                   {"camera", s.camera},
                   {"frames", frames},
                   {"fps", s.fps},
                   {"animation", s.animation},
                   {"variant", s.variant},
                   {"spp", s.spp},
                   {"error", s.error ? json(*s.error) : json(nullptr)},
                   {"max_depth", s.max_depth},
                   {"seed", s.seed},
                   {"tile", s.tile},
                   {"filter", filter_name(s.filter)},
                   {"filter_width", s.filter_width},
                   {"environment", s.environment},
                   {"environment_rotation", s.environment_rotation},
                   {"environment_strength", s.environment_strength},
                   {"background", background_json(s)},
                   {"half", s.half},
                   {"denoise", s.denoise},
                   {"clamp", s.clamp},
                   {"cull_backfaces", s.cull_backfaces},
                   {"guiding", s.is_guided()},
                   {"aov_bits", s.aovs}};
  settings["scene"] = s.scene >= 0 ? json(s.scene) : json(nullptr);
  return settings;
}

json workers_json(const JobReport& report) {
  json workers = json::array();
  for (const auto& [id, contribution] : report.contributions) {
    // A worker that has not connected since a restart: its machine is not journaled.
    const auto machine = report.machines.find(id);
    const bool known = machine != report.machines.end();
    workers.push_back({{"id", id},
                       {"isa", known ? json(machine->second.first) : json(nullptr)},
                       {"threads", known ? json(machine->second.second) : json(nullptr)},
                       {"units", contribution.units},
                       {"cpu_seconds", contribution.cpu_seconds}});
  }
  return workers;
}

/// The structure that rays were traced through. Means are null if its work was not counted.
json accelerator_json(const JobReport& report) {
  const JobCounters& counters = report.counters;
  const std::string& name = report.view.spec->settings.accelerator;
  const auto rays = static_cast<double>(counters.cost.rays);
  const auto per_ray = [&](std::int64_t count) {
    return rays > 0 ? json(static_cast<double>(count) / rays) : json(nullptr);
  };
  return {{"name", name.empty() ? "production" : name},
          {"builds", counters.accelerator_builds},
          {"build_seconds", counters.accelerator_build_seconds},
          {"memory_bytes", counters.accelerator_bytes},
          {"rays", rays > 0 ? json(counters.cost.rays) : json(nullptr)},
          {"nodes_per_ray", per_ray(counters.cost.nodes)},
          {"primitives_per_ray", per_ray(counters.cost.primitives)}};
}

}  // namespace

std::string report_json(const JobReport& report) {
  const JobView& view = report.view;
  const JobCounters& counters = report.counters;
  json frames = json::array(), warnings = json::array(), reasons = json::array();
  for (const std::string& warning : view.spec->scene_warnings) warnings.push_back(warning);
  for (const FrameRecord& frame : report.frames) {
    const FrameSummary summary = read_frame_summary(frame.statistics_json);
    json entry = json::parse(summary.entry_json, nullptr, false);
    if (!entry.is_object()) continue;
    entry["file_sha256"] = frame.file_sha256.hex();
    frames.push_back(std::move(entry));
    const std::string prefix = "frame " + std::to_string(frame.frame) + ": ";
    for (const std::string& warning : summary.warnings) warnings.push_back(prefix + warning);
    for (const std::string& reason : summary.reasons) reasons.push_back(prefix + reason);
  }
  for (const std::string& warning : report.warnings) warnings.push_back(warning);
  const contract::RenderSettings& settings = view.spec->settings;
  if (const int rounded = contract::rounded_spp(settings.spp); rounded != settings.spp) {
    warnings.push_back(absl::StrCat(settings.error ? "--max-spp " : "--spp ", settings.spp,
                                    " was rounded up to ", rounded));
  }
  if (!view.reason.empty()) reasons.push_back(view.reason);
  const double preparing = counters.load_seconds + counters.build_seconds;
  const double spent = preparing + view.cpu_seconds + counters.wasted_cpu_seconds;
  json document = {
      {"schema", "tessera.report/1"},
      {"version", TESSERA_VERSION},
      {"job", view.spec->id},
      {"name", view.spec->name},
      {"contract", view.spec->render_contract},
      {"status", view.certainty ? certainty_name(*view.certainty) : state_name(view.state)},
      {"reasons", reasons},
      {"warnings", warnings},
      {"scene_sha256", scene_sha256(*view.spec)},
      {"settings", settings_json(view.spec->settings)},
      {"frames", frames},
      {"cpu_seconds", view.cpu_seconds},
      {"cpu_seconds_wasted", counters.wasted_cpu_seconds},
      {"wall_seconds", view.elapsed_seconds},
      {"load_seconds", counters.load_seconds},
      {"build_seconds", counters.build_seconds},
      {"render_seconds", view.cpu_seconds},
      // Fraction of the workers' known CPU seconds that did not produce pixels.
      {"overhead_fraction", spent > 0 ? 1 - view.cpu_seconds / spent : 0},
      {"peak_rss_bytes", counters.peak_rss_bytes},
      {"accelerator", accelerator_json(report)},
      {"units",
       {{"total", view.unit_count},
        {"committed", view.committed_unit_count},
        {"retried", counters.retried},
        {"duplicated", counters.duplicated},
        {"redone", counters.redone},
        {"audited", counters.audited},
        {"mismatched", counters.mismatched}}},
      {"workers", workers_json(report)}};
  // Text from workers may contain invalid UTF-8.
  return document.dump(2, ' ', false, json::error_handler_t::replace);
}

}  // namespace tessera::server
