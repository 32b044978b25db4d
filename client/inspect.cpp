#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/commands.h"
#include "client/scene_probe.h"
#include "client/table.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

struct InspectOptions {
  std::string scene, environment;
  bool json = false;
};

double number(const ordered_json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : 0;
}

/// The strings of an array, joined; those of its objects by their name.
std::string joined(const ordered_json& list) {
  std::vector<std::string> words;
  for (const ordered_json& each : list) {
    const std::string name = each.is_object()   ? each.value("name", "")
                             : each.is_string() ? each.get<std::string>()
                                                : each.dump();
    words.push_back(name.empty() ? "(unnamed)" : name);
  }
  return absl::StrJoin(words, ", ");
}

std::string point(const ordered_json& coordinates) {
  std::vector<std::string> words;
  for (const ordered_json& each : coordinates) {
    words.push_back(absl::StrFormat("%.4g", each.is_number() ? each.get<double>() : 0.0));
  }
  return absl::StrCat("(", absl::StrJoin(words, ", "), ")");
}

/// A list of the file's contents, if it has any.
void add_list(Table& table, const ordered_json& object, const char* key, const char* title) {
  const auto found = object.find(key);
  if (found != object.end() && found->is_array() && !found->empty()) {
    table.add({title, joined(*found)});
  }
}

void add_counts(Table& table, const ordered_json& report) {
  const ordered_json counts = report.value("counts", ordered_json());
  if (counts.is_object()) {
    table.add(
        {"triangles",
         absl::StrFormat("%.0f, seen %.0f in %.0f instances", number(counts, "triangles"),
                         number(counts, "instanced_triangles"), number(counts, "instances"))});
    table.add({"materials",
               absl::StrFormat("%.0f, %.0f textures, %.0f images", number(counts, "materials"),
                               number(counts, "textures"), number(counts, "images"))});
    table.add({"lights",
               absl::StrFormat("%.0f punctual, %.0f emissive triangles", number(counts, "lights"),
                               number(counts, "emissive_triangles"))});
  }
  const ordered_json memory = report.value("memory", ordered_json());
  if (memory.is_object()) {
    table.add({"memory",
               absl::StrCat(format_bytes(number(memory, "total_bytes")), ": geometry ",
                            format_bytes(number(memory, "geometry_bytes")), ", images ",
                            format_bytes(number(memory, "image_bytes")), ", acceleration ",
                            format_bytes(number(memory, "acceleration_bytes")), ", lights ",
                            format_bytes(number(memory, "light_bytes")), ", the renderer itself ",
                            format_bytes(number(memory, "process_bytes")))});
  }
  const ordered_json bounds = report.value("bounds", ordered_json());
  if (bounds.is_object()) {
    table.add({"bounds", absl::StrCat(point(bounds.value("min", ordered_json())), " to ",
                                      point(bounds.value("max", ordered_json())), " m")});
  }
}

std::string text_of(const ordered_json& report, const SceneProbe& probe) {
  double bytes = 0;
  const ordered_json resources = report.value("resources", ordered_json::array());
  for (const ordered_json& resource : resources) bytes += number(resource, "bytes");
  Table table({"scene", report.value("scene", "")});
  table.add({"files", absl::StrCat(resources.size(), ", ", format_bytes(bytes))});
  add_list(table, report, "needs", "needs");
  add_counts(table, report);
  const ordered_json contents = report.value("contents", ordered_json::object());
  add_list(table, contents, "scenes", "scenes");
  add_list(table, contents, "cameras", "cameras");
  add_list(table, contents, "animations", "animations");
  add_list(table, contents, "variants", "variants");
  add_list(table, contents, "extensions_used", "extensions");
  std::string text = table.text();
  for (const SceneProbe::Problem& problem : probe.problems) {
    absl::StrAppend(&text, problem.severity, ": ", problem.text(), "\n");
  }
  return text;
}

int run(const InspectOptions& options) {
  const auto probe = probe_scene(options.scene, options.environment, nullptr);
  if (!probe.ok()) return fail(probe.status());
  if (options.json) {
    std::fputs(probe->json.c_str(), stdout);
  } else {
    const ordered_json report = ordered_json::parse(probe->json, nullptr, false);
    std::fputs(text_of(report, *probe).c_str(), stdout);
  }
  return probe->has_errors() ? kExitBadInput : kExitDone;
}

}  // namespace

void add_inspect_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<InspectOptions>();
  CLI::App* command =
      app.add_subcommand("inspect", "Say what a scene needs, its size, and what is wrong with it");
  command->add_option("scene", options->scene, "glTF file (.gltf or .glb)")->required();
  command->add_option("--environment", options->environment, "Sky image it will be rendered with")
      ->type_name("FILE");
  command->add_flag("--json", options->json, "Print a JSON document (tessera.inspect/1)");
  command->footer(
      "Returns 2 if the scene cannot be rendered.\nExamples:\n  tessera inspect scene.glb\n"
      "  tessera inspect scene.gltf --environment sky.exr --json");
  command->callback(
      [options, &invocation] { invocation.run = [options] { return run(*options); }; });
}

}  // namespace tessera::client
