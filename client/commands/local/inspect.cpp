#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "cli/command.h"
#include "client/charts/accelerators_svg.h"
#include "client/cli/table.h"
#include "client/commands/local/local_commands.h"
#include "client/output/frame_files.h"
#include "client/request/scene_report.h"
#include "contract/structure_names.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

struct InspectOptions {
  std::string scene, environment, accelerator, plot;
  bool json = false, accelerators = false, self_intersections = false, validate = false;
  bool vertex_distances = false;
};

double number(const ordered_json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : 0;
}

/// Joins the strings, or the names of the objects, of an array.
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

std::array<double, 3> coordinates_of(const ordered_json& object, const char* key) {
  std::array<double, 3> point = {};
  const ordered_json list = object.value(key, ordered_json::array());
  for (std::size_t k = 0; k < std::min(point.size(), list.size()); ++k) {
    if (list[k].is_number()) point[k] = list[k].get<double>();
  }
  return point;
}

/// Adds a row for a list in the report unless it is empty.
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
         absl::StrFormat("%.0f, instanced %.0f in %.0f instances", number(counts, "triangles"),
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
    table.add(
        {"memory", absl::StrCat(format_bytes(number(memory, "total_bytes")), ": geometry ",
                                format_bytes(number(memory, "geometry_bytes")), ", images ",
                                format_bytes(number(memory, "image_bytes")), ", acceleration ",
                                format_bytes(number(memory, "acceleration_bytes")), ", lights ",
                                format_bytes(number(memory, "light_bytes")), ", process ",
                                format_bytes(number(memory, "process_bytes")))});
  }
  const ordered_json bounds = report.value("bounds", ordered_json());
  if (bounds.is_object()) {
    table.add({"bounds",
               format_box(coordinates_of(bounds, "min"), coordinates_of(bounds, "max")) + " m"});
  }
}

/// Returns a number of an object as text; "-" if it has none.
std::string number_text(const ordered_json& of, const char* key) {
  const auto found = of.find(key);
  if (found == of.end() || !found->is_number()) return "-";
  return absl::StrFormat("%.4g", found->get<double>());
}

/// Returns the cost of searches for the nearest vertex.
std::string searches_text(const ordered_json& report) {
  const ordered_json nearest = report.value("nearest", ordered_json::object());
  std::string text = absl::StrFormat("nearest vertex of %.0f:", number(nearest, "searches"));
  for (const char* tree : {"kd_tree", "bvh"}) {
    const ordered_json cost = nearest.value(tree, ordered_json::object());
    absl::StrAppend(&text, tree[0] == 'b' ? "; BVH " : " kd-tree ",
                    number_text(cost, "nodes_per_search"), " nodes and ",
                    number_text(cost, "points_per_search"), " points per search");
  }
  return absl::StrCat(text, "; wrong ", number(nearest, "wrong"), "\n");
}

/// The table of acceleration structures.
std::string accelerators_text(const ordered_json& accelerators) {
  const ordered_json rays = accelerators.value("rays", ordered_json::object());
  Table table({"structure", "build s", "memory", "SAH", "overlap", "closest M/s", "nodes",
               "triangles", "any M/s", "nodes", "triangles", "wrong"});
  for (const ordered_json& row : accelerators.value("structures", ordered_json::array())) {
    const ordered_json closest = row.value("closest_hit", ordered_json::object());
    const ordered_json any = row.value("any_hit", ordered_json::object());
    table.add({row.value("name", ""), absl::StrFormat("%.3f", number(row, "build_seconds")),
               format_bytes(number(row, "memory_bytes")), number_text(row, "sah"),
               number_text(row, "end_point_overlap"), number_text(closest, "mrays_per_second"),
               number_text(closest, "nodes_per_ray"), number_text(closest, "triangles_per_ray"),
               number_text(any, "mrays_per_second"), number_text(any, "nodes_per_ray"),
               number_text(any, "triangles_per_ray"),
               absl::StrFormat("%.0f", number(closest, "wrong") + number(any, "wrong"))});
  }
  return absl::StrFormat(
             "\nrays: %.0f from the camera, %.0f after a bounce, %.0f towards lights. Nodes and "
             "triangles "
             "are "
             "per ray. SAH and overlap are expected costs of a tree per ray.\n%s",
             number(rays, "camera"), number(rays, "bounce"), number(rays, "shadow"), table.text()) +
         searches_text(accelerators);
}

/// Returns lines such as 'mesh "ring": closed, 3 intersecting triangle pairs: 0.12 and 0.40, …'.
std::string overlaps_text(const ordered_json& overlaps) {
  const auto add = [](std::string& text, const ordered_json& entry) {
    absl::StrAppend(&text, number(entry, "pair_count"), " intersecting triangle pairs");
    const char* separator = ": ";
    for (const ordered_json& pair : entry.value("pairs", ordered_json::array())) {
      absl::StrAppend(&text, separator, pair[0].dump(), ".", pair[1].dump(), " and ",
                      pair[2].dump(), ".", pair[3].dump());
      separator = ", ";
    }
    text += "\n";
  };
  std::string text;
  for (const ordered_json& mesh : overlaps.value("meshes", ordered_json::array())) {
    absl::StrAppend(&text, "mesh \"", mesh.value("name", ""), "\": ");
    if (mesh.value("closed", false)) {
      text += "closed, ";
    } else {
      absl::StrAppend(&text, "open (", number(mesh, "open_edges"), " boundary edges), ");
    }
    add(text, mesh);
  }
  for (const ordered_json& both : overlaps.value("instances", ordered_json::array())) {
    absl::StrAppend(&text, "nodes ", both["nodes"][0].dump(), " and ", both["nodes"][1].dump(),
                    ": ");
    add(text, both);
  }
  return text;
}

/// Returns lines such as "error: VALUE_NOT_IN_RANGE: /materials/0/alphaCutoff: …" and a summary.
std::string validation_text(const ordered_json& validation) {
  std::string text;
  for (const ordered_json& each : validation.value("findings", ordered_json::array())) {
    absl::StrAppend(&text, each.value("severity", ""), ": ", each.value("code", ""), ": ",
                    each.value("pointer", ""), ": ", each.value("message", ""), "\n");
  }
  absl::StrAppendFormat(&text, "glTF 2.0: errors %.0f, warnings %.0f, information %.0f, hints %.0f",
                        number(validation, "errors"), number(validation, "warnings"),
                        number(validation, "information"), number(validation, "hints"));
  if (const double omitted = number(validation, "omitted"); omitted > 0) {
    absl::StrAppendFormat(&text, "; %.0f more are not listed", omitted);
  }
  if (validation.value("partial", false)) text += "; some values were not checked";
  return text + "\n";
}

/// Returns lines such as 'vertices: 24, 1 m to the nearest other (median), ...'.
std::string distances_text(const ordered_json& distances) {
  std::string text = absl::StrFormat(
      "vertices: %.0f, %.4g m to the nearest other (median), at least %.4g m\n"
      "near vertices: %.0f pairs within %.4g m\n",
      number(distances, "vertices"), number(distances, "median"), number(distances, "smallest"),
      number(distances, "pair_count"), number(distances, "tolerance"));
  for (const ordered_json& pair : distances.value("pairs", ordered_json::array())) {
    const auto [x, y, z] = coordinates_of(pair, "at");
    absl::StrAppend(&text, absl::StrFormat("  (%.4g, %.4g, %.4g): ", x, y, z),
                    number_text(pair, "distance"), " m, nodes ", pair["nodes"][0].dump(), " and ",
                    pair["nodes"][1].dump(), "\n");
  }
  return text + searches_text(distances);
}

std::string text_of(const ordered_json& report, const SceneReport& scene) {
  double bytes = 0;
  const ordered_json resources = report.value("resources", ordered_json::array());
  for (const ordered_json& resource : resources) bytes += number(resource, "bytes");
  Table table({"scene", report.value("scene", "")});
  table.add({"files", absl::StrCat(resources.size(), ", ", format_bytes(bytes))});
  add_list(table, report, "needs", "features");
  add_counts(table, report);
  const ordered_json contents = report.value("contents", ordered_json::object());
  add_list(table, contents, "scenes", "scenes");
  add_list(table, contents, "cameras", "cameras");
  add_list(table, contents, "animations", "animations");
  add_list(table, contents, "variants", "variants");
  add_list(table, contents, "extensions_used", "extensions");
  std::string text = table.text();
  if (report.contains("self_intersections")) {
    text += overlaps_text(report["self_intersections"]);
  }
  if (report.contains("vertex_distances")) text += distances_text(report["vertex_distances"]);
  if (report.contains("accelerators")) text += accelerators_text(report["accelerators"]);
  for (const SceneReport::Problem& problem : scene.problems) {
    absl::StrAppend(&text, problem.severity, ": ", problem.text(), "\n");
  }
  if (report.contains("validation")) text += validation_text(report["validation"]);
  return text;
}

/// Writes the chart of the acceleration structures.
absl::Status write_plot(const std::string& path, const ordered_json& report) {
  const auto svg = accelerators_svg(report.value("accelerators", ordered_json::object()));
  if (!svg.ok()) return svg.status();
  return write_text_file(path, *svg);
}

int run(const InspectOptions& options) {
  std::vector<std::string> further;
  if (!options.accelerator.empty()) {
    further.insert(further.end(), {"--accelerator", options.accelerator});
  } else if (options.accelerators || !options.plot.empty()) {
    further.emplace_back("--accelerators");
  }
  if (options.self_intersections) further.emplace_back("--self-intersections");
  if (options.validate) further.emplace_back("--validate");
  if (options.vertex_distances) further.emplace_back("--vertex-distances");
  const auto scene = inspect_scene(options.scene, options.environment, nullptr, further);
  if (!scene.ok()) return fail(scene.status());
  const ordered_json report = ordered_json::parse(scene->json, nullptr, false);
  std::fputs(options.json ? scene->json.c_str() : text_of(report, *scene).c_str(), stdout);
  const bool is_invalid = number(report.value("validation", ordered_json::object()), "errors") > 0;
  if (scene->has_errors() || is_invalid) return kExitBadInput;
  if (options.plot.empty()) return kExitDone;
  const absl::Status plotted = write_plot(options.plot, report);
  return plotted.ok() ? kExitDone : fail(plotted);
}

}  // namespace

void add_inspect_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<InspectOptions>();
  CLI::App* command =
      cli::add_command(app, "inspect", "Show the features, size and faults of a scene");
  command->add_option("scene", options->scene, "glTF scene, .gltf or .glb")->required();
  command
      ->add_option("--environment", options->environment, "Environment map to check with the scene")
      ->type_name("FILE");
  command->add_flag("--accelerators", options->accelerators,
                    "Compare all acceleration structures on rays of the scene");
  command
      ->add_option("--accelerator", options->accelerator,
                   "Acceleration structure to compare with the production BVH")
      ->check(CLI::IsMember(contract::kStructureNames))
      ->type_name("NAME");
  command
      ->add_option("--plot", options->plot,
                   "SVG file to write the comparison of acceleration structures to")
      ->type_name("FILE");
  command->add_flag(
      "--self-intersections", options->self_intersections,
      "List intersecting triangles (primitive.triangle), and report which meshes are closed");
  command->add_flag("--validate", options->validate,
                    "List violations of the glTF 2.0 specification, with codes and JSON pointers");
  command->add_flag(
      "--vertex-distances", options->vertex_distances,
      "Measure distances between vertices, and list those that nearly coincide (cracks)");
  command->add_flag("--json", options->json, "Print JSON (tessera.inspect/1)");
  command->footer(
      "Exit code 2: the scene cannot be rendered or, with --validate, has errors.\nExamples:\n  "
      "tessera inspect scene.glb\n"
      "  tessera inspect scene.gltf --environment sky.exr --json");
  command->callback(
      [options, &invocation] { invocation.run = [options] { return run(*options); }; });
}

}  // namespace tessera::client
