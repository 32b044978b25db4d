#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "absl/strings/str_cat.h"
#include "cli/command.h"
#include "client/bench/bench_reference.h"
#include "client/bench/bench_stats.h"
#include "client/cli/table.h"
#include "client/commands/local/local_commands.h"
#include "client/local_farm/local_farm.h"
#include "client/output/frame_files.h"
#include "client/output/job_status.h"
#include "client/output/true_error.h"
#include "client/request/job_request.h"
#include "contract/digest.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

constexpr std::chrono::milliseconds kBenchWatchInterval{20};
constexpr std::chrono::seconds kBenchConnectTimeout{30};

struct BenchOptions {
  std::vector<std::string> scenes;
  std::string references, accelerator, environment;
  std::vector<int> spp = {8, 64, 512};
  int seeds = 3, threads = 1;
  bool guiding = false, json = false;
};

/// A scene and its reference.
struct Subject {
  std::string name, scene;
  BenchReference reference;
  std::vector<Image> image;  // the reference image only
  PreparedJob job;           // for any seed and sample count
};

absl::StatusOr<std::string> text_of_file(const std::string& path) {
  std::ifstream file(path);
  if (!file) return absl::InvalidArgumentError("cannot read the file");
  return std::string(std::istreambuf_iterator<char>(file), {});
}

/// Checks --environment against the reference, whose report has the name and digest of the
/// environment map but not its path.
absl::Status check_environment(const BenchReference& reference, const std::string& environment) {
  if (!reference.environment.empty() && environment.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("the reference uses the environment map ",
                                                   reference.environment,
                                                   "; pass that file with --environment"));
  }
  if (reference.environment.empty() && !environment.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("the reference has no environment map, but --environment is ", environment));
  }
  return absl::OkStatus();
}

/// Checks that the reference was rendered from the same files as the job.
absl::Status check_scene(const BenchReference& reference, const PreparedJob& job) {
  std::vector<contract::Digest> digests;
  for (const v1::ManifestEntry& entry : job.request.manifest().assets()) {
    digests.push_back(contract::Digest::from_binary(entry.asset().sha256()).value());
  }
  const std::string now = contract::sha256_of_set(std::move(digests)).hex();
  if (now == reference.scene_sha256) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("the scene or its environment map has changed since the reference was rendered "
                   "(scene_sha256 ",
                   reference.scene_sha256.substr(0, 12), "…, now ", now.substr(0, 12), "…)"));
}

/// Reads DIR/NAME.exr and DIR/NAME.json, written by `render`, and uses their settings.
absl::StatusOr<Subject> open_subject(const BenchOptions& options, const std::string& scene) {
  Subject subject;
  subject.name = stem_of(scene);
  subject.scene = scene;
  const std::string base = options.references + "/" + subject.name;
  const auto fault = [&](const char* file, const absl::Status& status) {
    return absl::InvalidArgumentError(absl::StrCat(
        base, file, ": ", status.message(), "; render a reference with: tessera render ", scene,
        " -o ", base, ".exr --report ", base, ".json --size 320x240 --spp 4096 --seed 1000003"));
  };
  const auto text = text_of_file(base + ".json");
  if (!text.ok()) return fault(".json", text.status());
  auto reference = read_reference_report(*text);
  if (!reference.ok()) return fault(".json", reference.status());
  subject.reference = *std::move(reference);
  if (absl::Status same = check_environment(subject.reference, options.environment); !same.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(base, ".json: ", same.message()));
  }
  RenderOptions render = subject.reference.render;
  render.accelerator = options.accelerator;
  render.guiding = options.guiding;  // not that of the reference: the expected image is the same
  render.scene = scene;
  render.environment = options.environment;
  auto job = prepare_job(render, subject.name);
  if (!job.ok()) return job.status();
  subject.job = *std::move(job);
  if (absl::Status same = check_scene(subject.reference, subject.job); !same.ok()) {
    return fault(".json", same);
  }
  auto image = read_image(base + ".exr");
  if (!image.ok()) return fault(".exr", image.status());
  subject.image.push_back(*std::move(image));
  return subject;
}

/// Runs the job to its end and returns its report with the true error.
absl::StatusOr<ordered_json> finish(FarmClient& client, const std::string& job_id,
                                    const Subject& subject) {
  const auto job =
      client.watch_job(job_id, kBenchWatchInterval, [](const v1::Job&) { return true; });
  if (!job.ok()) return job.status();
  if (job->state() != v1::Job::STATE_DONE) return absl::InternalError(job->reason());
  const auto text = client.get_report(job_id);
  if (!text.ok()) return text.status();
  auto report = ordered_json::parse(*text, nullptr, false);
  if (!report.is_object()) return absl::InternalError("the report is not JSON");
  const absl::Status added = add_true_errors(client, job_id, subject.image, report);
  if (!added.ok()) return added;
  return report;
}

/// Renders once and returns the report.
absl::StatusOr<ordered_json> render_once(FarmClient& client, const Subject& subject,
                                         std::int64_t seed, int spp) {
  if (absl::Status sent = upload_missing(client, subject.job); !sent.ok()) return sent;
  v1::CreateJobRequest request = subject.job.request;
  request.mutable_settings()->set_seed(seed);
  request.mutable_settings()->set_sample_count(spp);
  request.set_request_id(random_request_id());
  const auto made = client.create_job(request);
  if (!made.ok()) return made.status();
  auto report = finish(client, made->job().id(), subject);
  if (!report.ok()) return report;
  if (absl::Status gone = client.remove_job(made->job().id()); !gone.ok()) return gone;
  if (!(*report)["frames"].at(0)["true"].is_object()) {
    return absl::InternalError("the job has no image");
  }
  return report;
}

/// Adds the times of a render to the mean times.
void add_times(const ordered_json& report, const BenchOptions& options, SceneBench& bench) {
  const double share = 1.0 / options.seeds;
  const double load = report.value("load_seconds", 0.0), build = report.value("build_seconds", 0.0);
  const double render = report.value("render_seconds", 0.0);
  const ordered_json& rounds = report["frames"].at(0)["curve"];
  const double wall = report.value("wall_seconds", 0.0);
  bench.load += share * load;
  bench.build += share * build;
  bench.render += share * render;
  bench.wall += share * wall;
  bench.first_pixel += share * rounds.front().value("wall_seconds", 0.0);
  bench.rest += share * std::max(0.0, wall - load - build - render / options.threads);
}

/// Renders with one seed at each sample count. Times are measured at the last count.
absl::Status run_seed(FarmClient& client, const BenchOptions& options, const Subject& subject,
                      std::int64_t seed, SceneBench& bench) {
  std::vector<BenchPoint>& curve = bench.points.emplace_back();
  for (const int spp : bench.spp) {
    const auto report = render_once(client, subject, seed, spp);
    if (!report.ok()) return report.status();
    const ordered_json& frame = (*report)["frames"].at(0);
    curve.push_back(
        {frame["curve"].back().value("cpu_seconds", 0.0), frame["true"].value("relmse", 0.0)});
    if (spp == bench.spp.back()) add_times(*report, options, bench);
  }
  return absl::OkStatus();
}

absl::StatusOr<SceneBench> run_scene(FarmClient& client, const BenchOptions& options,
                                     const Subject& subject) {
  SceneBench bench;
  bench.scene = subject.name;
  bench.reference_relmse = subject.reference.relmse;
  bench.spp = options.spp;
  bench.seeds = bench_seeds(options.seeds, subject.reference.seed);
  for (const std::int64_t seed : bench.seeds) {
    std::fprintf(stderr, "%s: seed %lld, render %zu of %d\n", subject.name.c_str(),
                 static_cast<long long>(seed), bench.points.size() + 1, options.seeds);
    const absl::Status done = run_seed(client, options, subject, seed, bench);
    if (!done.ok()) {
      return absl::Status(done.code(), absl::StrCat(subject.scene, ": ", done.message()));
    }
  }
  return bench;
}

int run(BenchOptions options) {
  std::sort(options.spp.begin(), options.spp.end());
  options.spp.erase(std::unique(options.spp.begin(), options.spp.end()), options.spp.end());
  std::vector<Subject> subjects;
  for (const std::string& scene : options.scenes) {
    auto subject = open_subject(options, scene);
    if (!subject.ok()) return fail(subject.status());
    subjects.push_back(*std::move(subject));
  }
  LocalFarmOptions local;
  local.threads_per_worker = options.threads;
  auto farm = LocalFarm::start(local);  // forks: before any thread
  if (!farm.ok()) return fail(farm.status());
  if (absl::Status up = (*farm)->wait_until_up(); !up.ok()) return fail(up);
  Connection connection;
  connection.server = (*farm)->address();
  connection.connect_timeout = kBenchConnectTimeout;
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  (*farm)->on_death([&] { (*client)->cancel(); });
  std::vector<SceneBench> benches;
  for (const Subject& subject : subjects) {
    auto bench = run_scene(**client, options, subject);
    if (!bench.ok()) {
      const absl::Status health = (*farm)->health();
      return fail(health.ok() ? bench.status() : health);
    }
    benches.push_back(*std::move(bench));
  }
  (*farm)->on_death({});
  const std::string text =
      options.json ? bench_document(benches).dump(2) + "\n" : bench_text(benches);
  std::fputs(text.c_str(), stdout);
  return kExitDone;
}

}  // namespace

void add_bench_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<BenchOptions>();
  CLI::App* command = cli::add_command(app, "bench", "Measure CPU time and error on this machine");
  command->add_option("scene", options->scenes, "Scene files, .gltf or .glb")->required();
  command
      ->add_option("--reference", options->references,
                   "Directory with NAME.exr and NAME.json for each scene: image and report of a "
                   "long render, whose settings are used")
      ->required()
      ->type_name("DIR");
  command
      ->add_option("--seeds", options->seeds,
                   "Number of seeds per scene: 1, 2, 3, …, skipping that of the reference")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command
      ->add_option("--spp", options->spp,
                   "Comma-separated numbers of samples per pixel (default: 8,64,512)")
      ->delimiter(',')
      ->check(CLI::Range(1, 1 << 20));
  command->add_option("--threads", options->threads, "Threads of the worker")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command
      ->add_option("--environment", options->environment,
                   "Environment map of all scenes, the same file as for the references")
      ->type_name("FILE");
  add_accelerator_option(*command, options->accelerator);
  command->add_flag("--guiding", options->guiding, "Guide paths by photons");
  command->add_flag("--json", options->json, "Print JSON (tessera.bench/1)");
  command->footer(
      "Prints relMSE against the reference and CPU seconds (median and range over seeds), CPU "
      "seconds to relMSE 1e-2, 1e-3 and 1e-4, efficiency 1 / (relMSE x CPU seconds) with its 95 % "
      "interval, and geometric means. Values below ten times the reference's own relMSE are "
      "omitted.\n"
      "Example:\n  tessera render box.glb -o ref/box.exr --report ref/box.json --size 320x240 "
      "--spp 4096 --seed 1000003\n  tessera bench box.glb --reference ref --seeds 5");
  command->callback(
      [options, &invocation] { invocation.run = [options] { return run(*options); }; });
}

}  // namespace tessera::client
