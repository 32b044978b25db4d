// Descriptions of jobs that come with leases, and those that the worker asks a server for.
#include "worker/agent/server/job_fetcher.h"

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>
#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <memory>
#include <string>
#include <utility>

#include "tests/integration/server/support/made_job.h"
#include "tests/support/scratch_folder.h"

namespace tessera::agent {
namespace {

constexpr std::int32_t kWidthFromLease = 48;
constexpr std::int32_t kWidthFromServer = 32;

v1::RenderSettings settings_of(std::int32_t width) {
  v1::RenderSettings settings = server::request_of("job").settings();
  settings.set_width_px(width);
  return settings;
}

class CountingService : public v1::WorkerService::Service {
 public:
  std::atomic<int> calls = 0;

  grpc::Status DescribeJob(grpc::ServerContext*, const v1::DescribeJobRequest*,
                           v1::DescribeJobResponse* response) override {
    ++calls;
    *response->mutable_settings() = settings_of(kWidthFromServer);
    return grpc::Status::OK;
  }
};

class JobFetcherTest : public testing::Test {
 protected:
  JobFetcherTest() : cache_(*AssetCache::open(folder_.path(), 1 << 20)) {
    grpc::ServerBuilder builder;
    builder.RegisterService(&service_);
    server_ = builder.BuildAndStart();
    channel_ = std::make_unique<ServerChannel>(server_->InProcessChannel({}));
    fetcher_ = std::make_unique<JobFetcher>(
        *channel_, *cache_, metrics_, "", [this](const std::string&, const auto& inputs) {
          width_.set_value(inputs.ok() ? inputs->settings.width : -1);
        });
  }
  ~JobFetcherTest() override {
    fetcher_.reset();
    server_->Shutdown();
  }

  void describe() {
    v1::JobDescription job;
    job.set_job_id("job");
    *job.mutable_settings() = settings_of(kWidthFromLease);
    fetcher_->describe(job);
  }
  /// Fetches the job; returns the width of its image.
  std::int32_t fetch() {
    width_ = {};
    fetcher_->fetch("job");
    return width_.get_future().get();
  }

  ScratchFolder folder_;
  std::unique_ptr<AssetCache> cache_;
  AgentMetrics metrics_;
  CountingService service_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<ServerChannel> channel_;
  std::promise<std::int32_t> width_;
  std::unique_ptr<JobFetcher> fetcher_;
};

TEST_F(JobFetcherTest, DescribedJobNeedsNoCall) {
  describe();
  EXPECT_EQ(fetch(), kWidthFromLease);
  EXPECT_EQ(service_.calls, 0);
}

TEST_F(JobFetcherTest, DescriptionIsUsedOnce) {
  describe();
  fetch();
  EXPECT_EQ(fetch(), kWidthFromServer);
}

TEST_F(JobFetcherTest, EndedJobIsForgotten) {
  describe();
  fetcher_->forget("job");
  EXPECT_EQ(fetch(), kWidthFromServer);
  EXPECT_EQ(service_.calls, 1);
}

}  // namespace
}  // namespace tessera::agent
