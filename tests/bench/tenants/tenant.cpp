/// bench_tenant: a client of a farm with certificates. Steadily it creates jobs and lists a few,
/// and prints how long each call took; with --greedy it does all that its quotas refuse, as fast as
/// it can, and prints how often it was refused.
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "contract/render_settings.h"
#include "rpc/channel.h"
#include "tessera/v1/job_service.grpc.pb.h"
#include "tests/bench/coordinator/scene_upload.h"

namespace {

namespace v1 = tessera::v1;
using Clock = std::chrono::steady_clock;

constexpr char kScene[] = "{\"asset\":{\"version\":\"2.0\"}}";

struct Options {
  std::string server, certs;
  double seconds = 10, calls_per_s = 100, delay_seconds = 0;
  bool is_greedy = false;
  int connections = 4, threads = 8;
};

class Tenant {
 public:
  Tenant(std::shared_ptr<grpc::Channel> channel, std::string name)
      : channel_(std::move(channel)),
        jobs_(v1::JobService::NewStub(channel_)),
        name_(std::move(name)) {}

  /// Connects, which takes CPU time of the client and the server.
  bool connect() {
    return channel_->WaitForConnected(std::chrono::system_clock::now() + std::chrono::seconds(20));
  }
  bool upload() { return tessera::bench::upload(channel_, "", kScene); }
  grpc::Status create() {
    grpc::ClientContext context;
    tessera::contract::prepare_call(context, "", std::chrono::seconds(20));
    tessera::contract::RenderSettings settings;
    settings.width = 48;
    settings.height = 40;
    settings.tile = 16;
    settings.spp = 16;
    settings.max_depth = 4;
    v1::CreateJobRequest request = tessera::bench::job_request(
        "bench", name_ + "-" + std::to_string(++last_), settings, tessera::bench::asset_id(kScene));
    request.set_required_tag("nobody-has-it");
    v1::CreateJobResponse response;
    return jobs_->CreateJob(&context, request, &response);
  }
  grpc::Status list() {
    grpc::ClientContext context;
    tessera::contract::prepare_call(context, "", std::chrono::seconds(20));
    v1::ListJobsRequest request;
    request.set_page_size(10);
    v1::ListJobsResponse response;
    return jobs_->ListJobs(&context, request, &response);
  }
  grpc::Status watch_events() {
    grpc::ClientContext context;
    tessera::contract::prepare_call(context, "", std::chrono::seconds(2));
    v1::WatchEventsRequest request;
    request.set_follow(true);
    const auto stream = jobs_->WatchEvents(&context, request);
    for (v1::WatchEventsResponse response; stream->Read(&response);) {
    }
    return stream->Finish();
  }

 private:
  const std::shared_ptr<grpc::Channel> channel_;
  const std::unique_ptr<v1::JobService::Stub> jobs_;
  const std::string name_;
  std::atomic<int> last_ = 0;
};

/// Calls at a steady rate, and prints the milliseconds of each call from the time at which it was
/// due, so that a slow answer also counts for those that had to wait for it.
int run_steady(Tenant& tenant, const Options& options) {
  if (!tenant.upload()) return 1;
  const auto period = std::chrono::duration<double>(2 / options.calls_per_s);
  const Clock::time_point start = Clock::now();
  auto due = start;
  while (Clock::now() - start < std::chrono::duration<double>(options.seconds)) {
    std::this_thread::sleep_until(due);
    const Clock::time_point begin = due;
    const grpc::Status created = tenant.create();
    const Clock::time_point middle = Clock::now();
    const grpc::Status listed = tenant.list();
    const Clock::time_point end = Clock::now();
    if (!created.ok() || !listed.ok()) {
      std::fprintf(stderr, "%s %s\n", created.error_message().c_str(),
                   listed.error_message().c_str());
      return 1;
    }
    const auto ms = [](Clock::duration span) {
      return std::chrono::duration<double, std::milli>(span).count();
    };
    std::printf("%.4f %.4f\n", ms(middle - begin), ms(end - middle));
    due += std::chrono::duration_cast<Clock::duration>(period);
    due = std::max(due, end);
  }
  return 0;
}

int run_greedy(std::vector<std::unique_ptr<Tenant>>& tenants, const Options& options) {
  const Clock::time_point start =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(
                         std::chrono::duration<double>(options.delay_seconds));
  for (const auto& tenant : tenants) {
    if (!tenant->connect()) return 1;
  }
  tenants.front()->upload();
  std::atomic<long> done = 0, refused = 0;
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < tenants.size(); ++i) {
    for (int j = 0; j < options.threads; ++j) {
      threads.emplace_back([&, i, j] {
        std::this_thread::sleep_until(start);
        while (Clock::now() - start < std::chrono::duration<double>(options.seconds)) {
          const grpc::Status status = j == 0  ? tenants[i]->watch_events()
                                      : j % 2 ? tenants[i]->create()
                                              : tenants[i]->list();
          ++(status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED ? refused : done);
        }
      });
    }
  }
  for (std::thread& thread : threads) thread.join();
  std::printf("%ld %ld\n", done.load(), refused.load());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app("A client of a farm with certificates, for tests/bench/tenants/run.py.");
  app.add_option("--server", options.server)->required();
  app.add_option("--certs", options.certs)->required();
  app.add_option("--seconds", options.seconds);
  app.add_option("--calls-per-s", options.calls_per_s, "Of the steady client");
  app.add_flag("--greedy", options.is_greedy);
  app.add_option("--delay", options.delay_seconds,
                 "Seconds after which the greedy client, which has connected, begins to call");
  app.add_option("--connections", options.connections, "Of the greedy client");
  app.add_option("--threads", options.threads, "Of the greedy client, on each connection");
  CLI11_PARSE(app, argc, argv);
  std::vector<std::unique_ptr<Tenant>> tenants;
  for (int i = 0; i < (options.is_greedy ? options.connections : 1); ++i) {
    auto channel = tessera::contract::open_channel(options.server, options.certs);
    if (!channel.ok()) {
      std::fprintf(stderr, "%s\n", std::string(channel.status().message()).c_str());
      return 1;
    }
    tenants.push_back(
        std::make_unique<Tenant>(*channel, std::to_string(::getpid()) + "-" + std::to_string(i)));
  }
  return options.is_greedy ? run_greedy(tenants, options) : run_steady(*tenants.front(), options);
}
