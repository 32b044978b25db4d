#include <sys/stat.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "cli/finite_range.h"
#include "client/api/farm_client.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/frame_files.h"
#include "rpc/settings_message.h"

namespace tessera::client {
namespace {

struct FetchOptions {
  std::string job;
  std::string folder = ".";
  std::string format = "exr";
  double exposure_ev = 0;
  bool partial = false, force = false, json = false;
};

/// Result of fetching the frames of a job.
struct Outcome {
  nlohmann::ordered_json frames = nlohmann::ordered_json::array();
  int written = 0, already_there = 0, unfinished = 0, incomplete = 0;
};

absl::Status make_folder(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode)) return absl::OkStatus();
  if (::mkdir(path.c_str(), 0777) == 0) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat(path, ": cannot create the directory: ", std::strerror(errno)));
}

nlohmann::ordered_json missing_tiles(const v1::FrameHeader& header) {
  nlohmann::ordered_json tiles = nlohmann::ordered_json::array();
  for (const v1::PixelRect& rect : header.missing_tiles()) {
    tiles.push_back({{"x", rect.x_px()},
                     {"y", rect.y_px()},
                     {"width", rect.width_px()},
                     {"height", rect.height_px()}});
  }
  return tiles;
}

/// Fetches one frame. An unfinished frame is counted and is not an error.
absl::Status fetch_one(FarmClient& client, const FrameFile& file, Outcome& outcome) {
  const auto fetched = fetch_frame_file(client, file);
  if (!fetched.ok()) return fetched.status();
  if (!fetched->unfinished.empty()) {
    ++outcome.unfinished;
    std::fprintf(stderr, "frame %d: %s\n", file.frame, fetched->unfinished.c_str());
    outcome.frames.push_back({{"frame", file.frame}, {"state", "unfinished"}});
    return absl::OkStatus();
  }
  const bool whole = fetched->header.missing_tiles().empty();
  ++(fetched->already_there ? outcome.already_there : outcome.written);
  if (!whole) {
    ++outcome.incomplete;
    std::fprintf(stderr, "%s: %d tiles missing\n", file.path.c_str(),
                 fetched->header.missing_tiles_size());
  }
  outcome.frames.push_back({{"frame", file.frame},
                            {"state", fetched->already_there ? "present" : "written"},
                            {"file", file.path},
                            {"size_bytes", fetched->header.size_bytes()},
                            {"missing_tiles", missing_tiles(fetched->header)}});
  return absl::OkStatus();
}

void print_outcome(const FetchOptions& options, const v1::Job& job, const Outcome& outcome) {
  if (options.json) {
    const nlohmann::ordered_json document = {
        {"schema", "tessera.fetch/1"}, {"job", job.id()}, {"frames", outcome.frames}};
    std::printf("%s\n", document.dump(2).c_str());
    return;
  }
  for (const auto& frame : outcome.frames) {
    if (frame.contains("file")) {
      std::printf("%s\n", frame["file"].get_ref<const std::string&>().c_str());
    }
  }
  std::fprintf(stderr, "%d written, %d already present, %d unfinished, %d with missing tiles\n",
               outcome.written, outcome.already_there, outcome.unfinished, outcome.incomplete);
}

int run(const FetchOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto job = (*client)->get_job(options.job);
  if (!job.ok()) return fail(job.status());
  const auto settings = contract::from_message(job->settings());
  if (!settings.ok()) return fail(settings.status());
  if (const absl::Status made = make_folder(options.folder); !made.ok()) return fail(made);
  const std::string base = absl::StrCat(options.folder, "/", clean_name(job->name()));
  const std::string image = absl::StrCat(base, ".", options.format);
  const auto format = format_of(image);
  if (!format.ok()) return fail(format.status());

  const std::vector<std::int32_t> frames = contract::frame_list(settings->frames);
  Outcome outcome;
  for (const std::int32_t frame : frames) {
    const FrameFile file{job->id(),
                         frame,
                         frames.size() == 1 ? image : with_frame_number(image, frame),
                         *format,
                         options.exposure_ev,
                         options.partial,
                         options.force};
    if (const absl::Status status = fetch_one(**client, file, outcome); !status.ok()) {
      return fail(status);
    }
  }
  const auto report = (*client)->get_report(job->id());
  if (!report.ok()) return fail(report.status());
  const absl::Status written = write_text_file(base + ".report.json", *report);
  if (!written.ok()) return fail(written);
  print_outcome(options, *job, outcome);
  return outcome.written + outcome.already_there > 0 ? kExitDone : kExitBadInput;
}

}  // namespace

void add_fetch_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<FetchOptions>();
  CLI::App* command = cli::add_command(app, "fetch", "Download a job's finished frames and report");
  add_connection_options(*command, invocation.connection);
  add_job_argument(*command, options->job);
  command->add_option("-o,--output", options->folder, "Directory for the files, created if missing")
      ->capture_default_str()
      ->type_name("DIR");
  command->add_option("--format", options->format, "Image format")
      ->capture_default_str()
      ->check(CLI::IsMember({"exr", "png", "jpg"}));
  command->add_option("--exposure", options->exposure_ev, "Exposure in stops, PNG and JPEG only")
      ->type_name("EV")
      ->check(cli::finite_range(-100.0, 100.0))
      ->capture_default_str();
  command->add_flag("--partial", options->partial,
                    "Also download unfinished frames, and list their missing tiles");
  command->add_flag("--force", options->force, "Overwrite files that have different content");
  command->add_flag("--json", options->json, "Print JSON (tessera.fetch/1)");
  command->footer(
      "Several frames become NAME.FFFF.exr; the report is NAME.report.json. Existing files with "
      "the right content are kept. Exit code 2: no frame is available.\nExamples:\n"
      "  tessera fetch last -o frames\n"
      "  tessera fetch shot42 -o previews --format png --exposure 1 --partial");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
