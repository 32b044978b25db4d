/// bench_coordinator_job: creates a job for simulated workers, waits for its end, and compares the
/// hash of the merged pixels with that of the fabricated blocks.
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "rpc/channel.h"
#include "tests/bench/coordinator/client_options.h"
#include "tests/bench/coordinator/scene_upload.h"
#include "tests/bench/coordinator/simulated_block.h"

namespace {

using tessera::contract::RenderSettings;
namespace v1 = tessera::v1;

struct Options {
  std::string server, token;
  int width = 2048, height = 1024, tile = 8, spp = 8;
};

/// Watches the job until it ends and returns its final state.
v1::Job watch(v1::JobService::Stub& jobs, const std::string& id, const std::string& token) {
  grpc::ClientContext context;
  context.AddMetadata(tessera::contract::kTokenKey, token);
  v1::WatchJobRequest request;
  request.set_job_id(id);
  auto reader = jobs.WatchJob(&context, request);
  v1::WatchJobResponse message;
  v1::Job last;
  while (reader->Read(&message)) last = message.job();
  reader->Finish();
  return last;
}

int run(const Options& options) {
  RenderSettings settings;
  settings.width = options.width;
  settings.height = options.height;
  settings.tile = options.tile;
  settings.spp = options.spp;
  auto channel = tessera::contract::open_channel(options.server, "");
  if (!channel.ok()) {
    fprintf(stderr, "%s\n", std::string(channel.status().message()).c_str());
    return 2;
  }
  const std::string scene = "{\"asset\": {\"version\": \"2.0\"}}";
  if (!tessera::bench::upload(*channel, options.token, scene)) return 1;
  const auto jobs = v1::JobService::NewStub(*channel);
  grpc::ClientContext context;
  tessera::contract::prepare_call(context, options.token, std::chrono::seconds(20));
  v1::CreateJobResponse created;
  const auto start = std::chrono::steady_clock::now();
  const auto request = tessera::bench::job_request("bench", "bench-" + std::to_string(getpid()),
                                                   settings, tessera::bench::asset_id(scene));
  const grpc::Status status = jobs->CreateJob(&context, request, &created);
  if (!status.ok()) {
    fprintf(stderr, "CreateJob: %s\n", status.error_message().c_str());
    return 1;
  }
  const v1::Job job = watch(*jobs, created.job().id(), options.token);
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;

  grpc::ClientContext report_context;
  tessera::contract::prepare_call(report_context, options.token, std::chrono::seconds(60));
  v1::GetJobReportRequest report_request;
  v1::GetJobReportResponse report;  // its only part
  report_request.set_job_id(created.job().id());
  const auto report_stream = jobs->GetJobReport(&report_context, report_request);
  report_stream->Read(&report);
  const auto json = nlohmann::json::parse(report.report_json(), nullptr, false);
  std::string pixels;
  if (json.is_object() && json.contains("frames") && !json["frames"].empty()) {
    pixels = json["frames"][0].value("pixels_sha256", "");
  }
  const tessera::bench::SimulatedFilm film(settings);
  const bool right = pixels == film.expected_pixels().hex();
  printf(
      "{\"job\": \"%s\", \"state\": %d, \"units\": %lld, \"block_bytes\": %lld, "
      "\"wall_seconds\": %.3f, \"pixels_right\": %s}\n",
      created.job().id().c_str(), static_cast<int>(job.state()),
      static_cast<long long>(film.unit_count()), static_cast<long long>(film.block_bytes()),
      wall.count(), right ? "true" : "false");
  return job.state() == v1::Job::STATE_DONE && right ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape): a bench may die of one
  Options options;
  CLI::App app("A job of fabricated blocks for tests/bench/coordinator.");
  tessera::bench::add_server_options(app, options.server, options.token);
  app.add_option("--width", options.width, "pixels, a multiple of the tile");
  app.add_option("--height", options.height, "pixels, a multiple of the tile");
  app.add_option("--tile", options.tile, "pixels, a power of two");
  app.add_option("--spp", options.spp, "samples a pixel");
  CLI11_PARSE(app, argc, argv);
  return run(options);
}
