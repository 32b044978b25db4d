#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "cli/command.h"
#include "cli/finite_range.h"
#include "client/cli/progress.h"
#include "client/commands/local/local_commands.h"
#include "client/local_farm/local_farm.h"
#include "client/output/frame_files.h"
#include "client/output/job_status.h"
#include "client/output/render_result.h"
#include "client/output/true_error.h"
#include "client/request/job_request.h"
#include "rpc/settings_message.h"

namespace tessera::client {
namespace {

constexpr std::chrono::milliseconds kWatchInterval{200};
// For the local server, which is slow to start on a busy machine; if it dies, the wait ends at
// once.
constexpr std::chrono::seconds kConnectTimeout{30};

struct RenderCommandOptions {
  RenderOptions render;
  std::string output, name, store, report;
  double exposure_ev = 0;
  int workers = 1, threads = 0;
  bool force = false, json = false;
};

bool is_folder(const std::string& path) {
  struct stat info {};
  return ::stat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode);
}

/// Destination of the image; for several frames, frame numbers are inserted.
struct Output {
  std::string path;
  v1::FetchFrameRequest::Format format = v1::FetchFrameRequest::FORMAT_EXR;
  std::vector<std::int32_t> frames;
  std::string path_of(std::int32_t frame) const {
    return frames.size() == 1 ? path : with_frame_number(path, frame);
  }
};

/// Checks that the directory of `file` exists and is writable. Errors: InvalidArgument.
absl::Status check_folder_of(const std::string& file) {
  const std::size_t slash = file.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : file.substr(0, slash + 1);
  if (::access(folder.c_str(), W_OK | X_OK) == 0) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(folder, ": directory is missing or not writable"));
}

/// Checks all output paths before anything is rendered.
absl::StatusOr<Output> plan_output(const RenderCommandOptions& options) {
  const auto ranges = parse_frames(options.render.frames);
  if (!ranges.ok()) return ranges.status();
  Output output;
  output.frames = contract::frame_list(*ranges);
  const std::string name =
      clean_name(options.name.empty() ? stem_of(options.render.scene) : options.name) + ".exr";
  output.path = options.output.empty()      ? name
                : is_folder(options.output) ? options.output + "/" + name
                                            : options.output;
  const auto format = format_of(output.path);
  if (!format.ok()) return format.status();
  output.format = *format;
  absl::Status status = check_folder_of(output.path);
  if (!options.report.empty()) status.Update(check_folder_of(options.report));
  if (!status.ok()) return status;
  for (const std::int32_t frame : output.frames) {
    if (options.report == output.path_of(frame)) {
      return absl::InvalidArgumentError(
          absl::StrCat("--report ", options.report, ": same path as an output image"));
    }
  }
  for (const std::int32_t frame : output.frames) {
    // With a store, an earlier run may have written the files; their digests are checked at the
    // end.
    if (options.force || !options.store.empty()) break;
    if (::access(output.path_of(frame).c_str(), F_OK) == 0) {
      return absl::AlreadyExistsError(
          absl::StrCat(output.path_of(frame), " already exists; use --force to overwrite"));
    }
  }
  return output;
}

/// Returns a warning about options that the file format does not support; may be empty.
std::string ignored_options(const RenderCommandOptions& options, const Output& output) {
  std::vector<std::string> ignored;
  if (!options.render.aovs.empty()) ignored.emplace_back("--aov");
  if (options.render.half) ignored.emplace_back("--half");
  if (output.format == v1::FetchFrameRequest::FORMAT_EXR || ignored.empty()) return {};
  return absl::StrCat("tessera: ", output.path, ": ignoring ", absl::StrJoin(ignored, " and "),
                      ", supported only for EXR\n");
}

LocalFarmOptions farm_options(const RenderCommandOptions& options) {
  LocalFarmOptions farm;
  farm.store = options.store;
  farm.worker_count = options.workers;
  const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  farm.threads_per_worker =
      options.threads > 0 ? options.threads : std::max(1, cores / options.workers);
  return farm;
}

/// Creates the job, or finds that of an earlier run in the store, and starts or resumes it.
absl::StatusOr<v1::Job> start_job(FarmClient& client, const PreparedJob& prepared) {
  if (absl::Status status = upload_missing(client, prepared); !status.ok()) return status;
  v1::CreateJobRequest request = prepared.request;
  request.set_request_id(derived_request_id(request));
  const auto made = client.create_job(request);
  if (!made.ok()) return made.status();
  const v1::Job& job = made->job();
  if (job.state() == v1::Job::STATE_PAUSED) return client.resume_job(job.id());
  const bool has_stopped =
      job.state() == v1::Job::STATE_FAILED || job.state() == v1::Job::STATE_CANCELLED;
  return has_stopped ? client.retry_job(job.id()) : job;
}

/// Downloads a job's frames as they are finished.
class FrameCollector {
 public:
  /// All references must outlive it.
  FrameCollector(FarmClient& client, const RenderCommandOptions& options, const Output& output)
      : client_(client), options_(options), output_(output), pending_(output.frames) {}

  /// Downloads the frames finished so far. Frames finish nearly in order, so few requests are
  /// unsuccessful. Errors: those of fetch_frame_file.
  absl::Status collect(const v1::Job& job) {
    const auto finished = static_cast<std::size_t>(job.progress().finished_frame_count());
    for (auto frame = pending_.begin();
         frame != pending_.end() && output_.frames.size() - pending_.size() < finished;) {
      const FrameFile file{
          job.id(), *frame,        output_.path_of(*frame), output_.format, options_.exposure_ev,
          false,    options_.force};
      const auto fetched = fetch_frame_file(client_, file);
      if (!fetched.ok()) return fetched.status();
      frame = fetched->unfinished.empty() ? pending_.erase(frame) : frame + 1;
    }
    return absl::OkStatus();
  }
  bool has_all() const { return pending_.empty(); }

 private:
  FarmClient& client_;
  const RenderCommandOptions& options_;
  const Output& output_;
  std::vector<std::int32_t> pending_;  // not downloaded yet, in order
};

/// A private farm pauses its job only when it cannot store results; nobody is there to resume it.
absl::Status check_not_stopped(const v1::Job& job) {
  if (job.state() != v1::Job::STATE_PAUSED || job.reason().empty()) return absl::OkStatus();
  if (is_paused_by_failures(job)) return absl::OkStatus();  // ends the command like a failure
  return absl::ResourceExhaustedError(
      absl::StrCat("the job has stopped: ", job.reason(),
                   "; free disk space, or set --store to a directory on another disk"));
}

/// Runs the job on the farm and returns its report, also if it failed. Sets `job_exit_code`.
absl::StatusOr<nlohmann::ordered_json> render_on(FarmClient& client,
                                                 const RenderCommandOptions& options,
                                                 const PreparedJob& prepared, const Output& output,
                                                 int& job_exit_code) {
  auto job = start_job(client, prepared);
  if (!job.ok()) return job.status();
  ProgressBar bar;
  FrameCollector collector(client, options, output);
  absl::Status collected;
  job = client.watch_job(job->id(), kWatchInterval, [&](const v1::Job& now) {
    bar.show(now);
    collected = collector.collect(now);
    if (collected.ok()) collected = check_not_stopped(now);
    return collected.ok() && !is_paused_by_failures(now);
  });
  bar.clear();
  if (!job.ok()) return job.status();
  if (!collected.ok()) return collected;
  job_exit_code = exit_code_of(*job);
  if (job->state() != v1::Job::STATE_DONE) {
    std::fprintf(stderr, "tessera: job %s: %s\n", state_name(job->state()).c_str(),
                 job->reason().c_str());
  } else if (!collector.has_all()) {
    return absl::InternalError("the job is done, but some frames could not be downloaded");
  }
  const auto text = client.get_report(job->id());
  if (!text.ok()) return text.status();
  auto report = nlohmann::ordered_json::parse(*text, nullptr, false);
  if (!report.is_object()) return absl::InternalError("the report is not JSON");
  if (job->state() == v1::Job::STATE_DONE && !prepared.references.empty()) {
    const absl::Status added = add_true_errors(client, job->id(), prepared.references, report);
    if (!added.ok()) job_exit_code = fail(added);  // the rest of the report is valid
  }
  return report;
}

int run(const RenderCommandOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  const auto output = plan_output(options);
  if (!output.ok()) return fail(output.status());
  std::fputs(ignored_options(options, *output).c_str(), stderr);
  // The farm starts while the scene is inspected.
  auto farm = LocalFarm::start(farm_options(options));  // forks: before any thread
  if (!farm.ok()) return fail(farm.status());
  SignalHandler signals;
  const auto prepared = prepare_job(options.render, options.name);
  if (!prepared.ok()) return fail(prepared.status());
  for (const std::string& remark : prepared->remarks) {
    std::fprintf(stderr, "%s\n", remark.c_str());
  }
  absl::Status up = (*farm)->wait_until_up();
  if (!up.ok()) return fail(up);
  Connection connection;
  connection.server = (*farm)->address();
  connection.connect_timeout = kConnectTimeout;
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());

  if (signals.interrupted()) return kExitInterrupted;
  int job_exit_code = kExitDone;
  absl::StatusOr<nlohmann::ordered_json> report = absl::UnknownError("");
  {
    const InterruptAction action(signals, [&] { (*client)->cancel(); });
    (*farm)->on_death([&] { (*client)->cancel(); });
    report = render_on(**client, options, *prepared, *output, job_exit_code);
    (*farm)->on_death({});
  }
  if (signals.interrupted()) {
    std::fprintf(stderr, "tessera: interrupted%s\n",
                 options.store.empty() ? "" : "; run the same command to resume");
    return kExitInterrupted;
  }
  if (const absl::Status health = (*farm)->health(); !report.ok() && !health.ok()) {
    return fail(health);
  }
  if (!report.ok()) return fail(report.status());
  std::vector<std::string> files;
  for (const std::int32_t frame : output->frames) files.push_back(output->path_of(frame));
  name_files(*report, files);
  if (!options.report.empty()) {
    const absl::Status written = write_text_file(options.report, report->dump(2) + "\n");
    if (!written.ok()) return fail(written);
  }
  if (options.json) {
    std::printf("%s\n", report->dump().c_str());
  } else if (job_exit_code == kExitDone || job_exit_code == kExitUncertain) {
    std::fputs(warning_lines(*report, prepared->remarks).c_str(), stderr);
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
    std::printf("%s\n", result_line(*report, wall.count()).c_str());
  }
  return job_exit_code;
}

}  // namespace

void add_render_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<RenderCommandOptions>();
  CLI::App* command = cli::add_command(app, "render", "Render a scene on this machine");
  add_render_options(*command, options->render);
  const char* group = "Output";
  command
      ->add_option(
          "-o,--output", options->output,
          "Output image (.exr, .png or .jpg) or directory (default: the scene's name with .exr)")
      ->type_name("FILE")
      ->group(group);
  command->add_option("--exposure", options->exposure_ev, "Exposure in stops, PNG and JPEG only")
      ->check(cli::finite_range(-100.0, 100.0))
      ->type_name("EV")
      ->group(group);
  command->add_option("--report", options->report, "File to write the JSON report to")
      ->type_name("FILE")
      ->group(group);
  command->add_flag("--force", options->force, "Overwrite existing files")->group(group);
  command->add_flag("--json", options->json, "Print the JSON report instead of one line")
      ->group(group);
  group = "Local farm";
  command->add_option("--workers", options->workers, "Number of worker processes")
      ->check(CLI::Range(1, 256))
      ->type_name("N")
      ->capture_default_str()
      ->group(group);
  command
      ->add_option("--threads", options->threads,
                   "Threads per worker (default: cores divided by workers)")
      ->check(CLI::Range(1, 1024))
      ->type_name("N")
      ->group(group);
  command
      ->add_option("--store", options->store,
                   "Directory for intermediate results; rerun the command to resume")
      ->type_name("DIR")
      ->group(group);
  command->add_option("--name", options->name, "Name of the job (default: that of the scene file)")
      ->group(group);
  command->footer(
      "Examples:\n  tessera render scene.glb -o out.exr --spp 256\n"
      "  tessera render scene.glb -o out.exr --error 0.05\n"
      "  tessera render scene.gltf -o out.png --exposure 1 --size 640x360\n"
      "  tessera render anim.glb --frames 0-47 --store work");
  command->callback(
      [options, &invocation] { invocation.run = [options] { return run(*options); }; });
}

}  // namespace tessera::client
