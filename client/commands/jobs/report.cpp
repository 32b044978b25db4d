#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/charts/curve_svg.h"
#include "client/charts/tile_svg.h"
#include "client/charts/timeline.h"
#include "client/cli/progress.h"
#include "client/cli/table.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/frame_files.h"
#include "client/output/true_error.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

struct ReportOptions {
  std::string job, svg, tiles, trace, reference;
  bool json = false, csv = false;

  /// Returns whether to print: if files are requested, only with --json or --csv.
  bool prints() const { return json || csv || (svg.empty() && tiles.empty() && trace.empty()); }
};

/// Returns the number at `pointer` as "%.*g"; "-" if it is null or missing.
std::string figure(const ordered_json& document, const char* pointer, int digits = 4) {
  const ordered_json::json_pointer path(pointer);
  if (!document.contains(path) || !document[path].is_number()) return "-";
  return absl::StrFormat("%.*g", digits, document[path].get<double>());
}

std::string text_at(const ordered_json& document, const char* key) {
  const auto found = document.find(key);
  return found != document.end() && found->is_string() ? found->get<std::string>() : "-";
}

double number_at(const ordered_json& document, const char* key) {
  const auto found = document.find(key);
  return found != document.end() && found->is_number() ? found->get<double>() : 0;
}

std::string frames_table(const ordered_json& report) {
  Table table({"FRAME", "STATUS", "SIZE", "SPP", "ERROR", "<= 95 %", "RELMSE", "RMSE", "TOP 0.1 %",
               "TRUE", "DROPPED", "PIXELS"});
  for (const ordered_json& frame : report.value("frames", ordered_json::array())) {
    table.add({figure(frame, "/frame", 9), text_at(frame, "status"),
               absl::StrCat(figure(frame, "/width"), "x", figure(frame, "/height")),
               figure(frame, "/spp_mean", 6), figure(frame, "/estimated/error"),
               figure(frame, "/estimated/error_upper95"), figure(frame, "/estimated/relmse"),
               figure(frame, "/estimated/rmse"), figure(frame, "/heavy_tail_share", 3),
               figure(frame, "/true/error"), figure(frame, "/dropped_samples", 9),
               text_at(frame, "pixels_sha256").substr(0, 12)});
  }
  return table.text();
}

std::string workers_table(const ordered_json& report) {
  Table table({"WORKER", "ISA", "THREADS", "UNITS", "CPU S"});
  for (const ordered_json& worker : report.value("workers", ordered_json::array())) {
    table.add({text_at(worker, "id"), text_at(worker, "isa"), figure(worker, "/threads"),
               figure(worker, "/units", 12), figure(worker, "/cpu_seconds")});
  }
  return table.text();
}

std::string text_of(const ordered_json& report) {
  std::string text = absl::StrCat("job ", text_at(report, "job"), "  ", text_at(report, "status"),
                                  ", contract ", figure(report, "/contract"), ", scene ",
                                  text_at(report, "scene_sha256").substr(0, 12), "\n");
  for (const char* list : {"reasons", "warnings"}) {
    for (const ordered_json& line : report.value(list, ordered_json::array())) {
      if (line.is_string()) absl::StrAppend(&text, "  ! ", line.get<std::string>(), "\n");
    }
  }
  absl::StrAppend(&text, "\n", frames_table(report), "\n", workers_table(report), "\n");
  absl::StrAppend(&text, "cpu ", figure(report, "/cpu_seconds"), " s (",
                  figure(report, "/cpu_seconds_wasted"), " s wasted), wall ",
                  format_seconds(number_at(report, "wall_seconds")), ", load ",
                  figure(report, "/load_seconds"), " s, build ", figure(report, "/build_seconds"),
                  " s, render ", figure(report, "/render_seconds"), " s, overhead ",
                  format_share(number_at(report, "overhead_fraction"), 1), ", peak memory ",
                  format_bytes(number_at(report, "peak_rss_bytes")), "\n");
  if (report.contains("accelerator")) {
    absl::StrAppend(&text, "accelerator ", text_at(report["accelerator"], "name"), ", built in ",
                    figure(report, "/accelerator/build_seconds"), " s, ",
                    format_bytes(number_at(report["accelerator"], "memory_bytes")), ", per ray ",
                    figure(report, "/accelerator/nodes_per_ray"), " nodes and ",
                    figure(report, "/accelerator/primitives_per_ray"), " primitives\n");
  }
  absl::StrAppend(&text, "units ", figure(report, "/units/total", 12), ", retried ",
                  figure(report, "/units/retried", 12), ", duplicated ",
                  figure(report, "/units/duplicated", 12), ", audited ",
                  figure(report, "/units/audited", 12), ", mismatched ",
                  figure(report, "/units/mismatched", 12), "\n");
  return text;
}

/// Returns the error curves of all frames as CSV, one point per line.
std::string csv_of(const ordered_json& report) {
  std::string text = "frame,cpu_seconds,wall_seconds,samples,relmse,error,error_true\n";
  for (const ordered_json& frame : report.value("frames", ordered_json::array())) {
    for (const ordered_json& point : frame.value("curve", ordered_json::array())) {
      absl::StrAppend(&text, figure(frame, "/frame", 9));
      for (const char* key :
           {"/cpu_seconds", "/wall_seconds", "/samples", "/relmse", "/error", "/error_true"}) {
        const std::string value = figure(point, key, 17);
        absl::StrAppend(&text, ",", value == "-" ? "" : value);
      }
      text += '\n';
    }
  }
  return text;
}

absl::Status write_curve(const std::string& path, const ordered_json& report) {
  const std::string drawing = curve_svg(report);
  if (drawing.empty()) return absl::FailedPreconditionError("no frame has an error curve yet");
  return write_text_file(path, drawing);
}

absl::Status write_tiles(const std::string& path, const ordered_json& report) {
  const auto drawing = tile_svg(report);
  return drawing.ok() ? write_text_file(path, *drawing) : drawing.status();
}

absl::Status write_timeline(const std::string& path, FarmClient& client,
                            const ordered_json& report) {
  const auto deliveries = client.list_deliveries(text_at(report, "job"));
  if (!deliveries.ok()) return deliveries.status();
  std::vector<v1::Event> events;
  absl::Status status = client.watch_events({}, [&](const v1::Event& event) {
    events.push_back(event);
    return true;
  });
  if (!status.ok()) return status;
  const auto timeline = timeline_json(report, *deliveries, events);
  return timeline.ok() ? write_text_file(path, *timeline) : timeline.status();
}

/// Writes all requested files that can be written. Returns the first error.
absl::Status write_files(const ReportOptions& options, FarmClient& client,
                         const ordered_json& report) {
  absl::Status status;
  if (!options.svg.empty()) status.Update(write_curve(options.svg, report));
  if (!options.tiles.empty()) status.Update(write_tiles(options.tiles, report));
  if (!options.trace.empty()) status.Update(write_timeline(options.trace, client, report));
  return status;
}

int run(const ReportOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto job = (*client)->get_job(options.job);
  if (!job.ok()) return fail(job.status());
  const auto bytes = (*client)->get_report(job->id());
  if (!bytes.ok()) return fail(bytes.status());
  ordered_json report = ordered_json::parse(*bytes, nullptr, false);
  if (!report.is_object()) return fail(absl::InternalError("the server's report is not JSON"));
  if (!options.reference.empty()) {
    const auto references =
        read_references(options.reference, frames_of(report), window_of(report));
    if (!references.ok()) return fail(references.status());
    const absl::Status added = add_true_errors(**client, job->id(), *references, report);
    if (!added.ok()) return fail(added);
  }
  const absl::Status written = write_files(options, **client, report);
  if (!options.prints()) return written.ok() ? kExitDone : fail(written);
  const std::string text = options.json  ? report.dump(2) + "\n"
                           : options.csv ? csv_of(report)
                                         : text_of(report);
  std::fputs(text.c_str(), stdout);
  return written.ok() ? kExitDone : fail(written);
}

}  // namespace

void add_report_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<ReportOptions>();
  CLI::App* command = cli::add_command(app, "report", "Show the results and costs of a job");
  add_connection_options(*command, invocation.connection);
  add_job_argument(*command, options->job);
  CLI::Option* json = command->add_flag("--json", options->json, "Print JSON (tessera.report/1)");
  command->add_flag("--csv", options->csv, "Print the error curves as CSV, one point per line")
      ->excludes(json);
  command->add_option("--svg", options->svg, "SVG file to write the error curves to")
      ->type_name("FILE");
  command
      ->add_option("--tiles", options->tiles,
                   "SVG file to write the error and samples of each tile to")
      ->type_name("FILE");
  command
      ->add_option("--trace", options->trace,
                   "JSON file to write the timeline of the job's units to, for ui.perfetto.dev and "
                   "chrome://tracing")
      ->type_name("FILE");
  command
      ->add_option(
          "--reference", options->reference,
          "Reference image for the true error; with several frames, one image for each, named "
          "REF.0007.exr")
      ->type_name("REF.exr");
  command->footer(
      "With --svg, --tiles or --trace, nothing is printed unless --json or --csv is given.\n"
      "Examples:\n  tessera report last\n  tessera report last --json > report.json\n"
      "  tessera report last --svg curve.svg");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
