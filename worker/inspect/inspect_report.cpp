#include "worker/inspect/inspect_report.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "worker/gltf/file/folder_reader.h"
#include "worker/inspect/light_through_glass.h"
#include "worker/inspect/solid_check.h"
#include "worker/scene/visible_bounds.h"

namespace tessera::render {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

const char* severity_name(Problem::Severity severity) {
  switch (severity) {
    case Problem::Severity::error:
      return "error";
    case Problem::Severity::warning:
      return "warning";
    case Problem::Severity::note:
      return "note";
  }
  return "error";
}

/// Splits "FILE: ELEMENT: FAULT", the form of the loader's statuses.
InspectReport::Finding finding_of(const absl::Status& status, const std::string& scene) {
  std::string text(status.message());
  InspectReport::Finding out;
  out.file = scene;
  const auto take = [&text] {
    const std::size_t colon = text.find(": ");
    if (colon == std::string::npos) return std::string();
    std::string head = text.substr(0, colon);
    text.erase(0, colon + 2);
    return head;
  };
  if (const std::string file = take(); !file.empty()) out.file = file;
  out.problem.element = take();
  out.problem.message = text;
  return out;
}

void add_resource(const FolderReader& reader, const std::string& uri, const char* kind,
                  InspectReport& report) {
  const fs::path path = reader.path_of(uri);
  if (path.empty()) return;
  std::error_code error;
  const auto bytes = fs::file_size(path, error);
  report.resources.push_back(
      {uri, path.string(), kind, error ? 0 : static_cast<std::int64_t>(bytes)});
}

void add_pose(const Scene& scene, InspectReport& report) {
  report.posed = true;
  report.features = features_of(scene);
  const Box3d bounds = visible_bounds(scene);
  for (int k = 0; k < 3 && !bounds.empty(); ++k) {
    report.bounds_min[static_cast<std::size_t>(k)] = bounds.lo[k] + scene.center[k];
    report.bounds_max[static_cast<std::size_t>(k)] = bounds.hi[k] + scene.center[k];
  }
  for (Problem& problem : check_light_through_glass(scene)) {
    report.findings.push_back({report.scene, std::move(problem)});
  }
  for (Problem& problem : check_solids(scene)) {
    report.findings.push_back({report.scene, std::move(problem)});
  }
}

json counts_of(const SceneFeatures& n) {
  return {{"triangles", n.triangles},
          {"instanced_triangles", n.instanced_triangles},
          {"vertices", n.vertices},
          {"meshes", n.meshes},
          {"primitives", n.primitives},
          {"instances", n.instances},
          {"materials", n.materials},
          {"textures", n.textures},
          {"images", n.images},
          {"lights", n.lights},
          {"emissive_triangles", n.emissive_triangles}};
}

json contents_of(const SceneContents& c) {
  json animations = json::array();
  for (const auto& clip : c.animations) {
    animations.push_back({{"name", clip.name}, {"seconds", clip.seconds}});
  }
  return {{"scenes", c.scenes},
          {"cameras", c.cameras},
          {"animations", animations},
          {"variants", c.variants},
          {"extensions_used", c.extensions_used},
          {"extensions_required", c.extensions_required}};
}

/// The member "validation" of tessera.inspect/1.
json validation_of(const ValidationResult& result) {
  constexpr const char* kSeverities[] = {"error", "warning", "information", "hint"};
  const ValidationFindings& findings = result.findings;
  json list = json::array();
  for (const ValidationFinding& each : findings.kept()) {
    list.push_back({{"code", each.rule->code},
                    {"severity", kSeverities[static_cast<std::size_t>(each.rule->severity)]},
                    {"pointer", each.pointer},
                    {"message", each.message}});
  }
  return {{"errors", findings.count(FindingSeverity::error)},
          {"warnings", findings.count(FindingSeverity::warning)},
          {"information", findings.count(FindingSeverity::information)},
          {"hints", findings.count(FindingSeverity::hint)},
          {"omitted", findings.omitted()},
          {"partial", result.is_partial},
          {"findings", list}};
}

/// Validates the scene's file; a file that cannot be read is a finding of the loader.
void add_validation(ResourceReader& reader, InspectReport& report) {
  const auto bytes = reader.read(report.scene);
  if (bytes.ok()) report.validation = validate_gltf(*bytes, reader);
}

}  // namespace

bool InspectReport::has_errors() const {
  const bool is_invalid = validation && validation->findings.count(FindingSeverity::error) > 0;
  return is_invalid || std::any_of(findings.begin(), findings.end(), [](const Finding& f) {
           return f.problem.severity == Problem::Severity::error;
         });
}

InspectReport inspect_scene(const InspectRequest& request) {
  InspectReport report;
  report.scene = request.scene.filename().string();
  FolderReader reader(request.scene.parent_path());
  contract::RenderSettings settings = request.settings;
  if (request.environment.empty()) {
    settings.environment.clear();
  } else {
    if (settings.environment.empty()) {
      settings.environment = request.environment.filename().string();
    }
    reader.allow(settings.environment, request.environment);
  }
  auto file = load_scene_file(report.scene, settings, reader);
  if (file.ok()) {
    report.contents = (*file)->contents();
    const std::vector<std::int32_t> frames = contract::frame_list(settings.frames);
    const auto scene = (*file)->pose(settings, frames.empty() ? 0 : frames.front());
    for (const Problem& p : (*file)->problems()) report.findings.push_back({report.scene, p});
    if (scene.ok()) {
      add_pose(*scene, report);
      if (request.examine) request.examine(*scene, report);
    } else {
      report.findings.push_back(finding_of(scene.status(), report.scene));
    }
  } else {
    report.findings.push_back(finding_of(file.status(), report.scene));
  }
  if (request.validate) add_validation(reader, report);
  for (const std::string& uri : reader.uris()) {
    const bool is_environment = !settings.environment.empty() && uri == settings.environment;
    add_resource(reader, uri,
                 uri == report.scene ? "scene"
                 : is_environment    ? "environment"
                                     : "data",
                 report);
  }
  return report;
}

std::string to_json(const InspectReport& report) {
  json out = {{"schema", "tessera.inspect/1"},
              {"scene", report.scene},
              {"ok", !report.has_errors()},
              {"resources", json::array()},
              {"problems", json::array()},
              {"contents", contents_of(report.contents)},
              {"needs", nullptr},
              {"counts", nullptr},
              {"memory", nullptr},
              {"bounds", nullptr}};
  for (const auto& r : report.resources) {
    out["resources"].push_back(
        {{"uri", r.uri}, {"file", r.file}, {"kind", r.kind}, {"bytes", r.bytes}});
  }
  for (const auto& f : report.findings) {
    out["problems"].push_back({{"severity", severity_name(f.problem.severity)},
                               {"file", f.file},
                               {"element", f.problem.element},
                               {"message", f.problem.message}});
  }
  if (report.posed) {
    out["needs"] = feature_names(report.features.features);
    out["counts"] = counts_of(report.features);
    out["memory"] = {{"geometry_bytes", report.features.geometry_bytes},
                     {"image_bytes", report.features.image_bytes},
                     {"acceleration_bytes", report.features.acceleration_bytes},
                     {"light_bytes", report.features.light_bytes},
                     {"process_bytes", kProcessBytes},
                     {"total_bytes", report.features.total_bytes()}};
    out["bounds"] = {{"min", report.bounds_min}, {"max", report.bounds_max}};
  }
  if (report.validation) out["validation"] = validation_of(*report.validation);
  for (const auto& [name, text] : report.extras) out[name] = json::parse(text);
  // Names come from the file: invalid UTF-8 is replaced instead of throwing.
  return out.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace tessera::render
