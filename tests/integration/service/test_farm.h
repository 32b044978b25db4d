#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "proto/contract/channel.h"
#include "proto/contract/film_block.h"
#include "proto/contract/tile_grid.h"
#include "server/coordinator.h"
#include "server/service/access.h"
#include "server/service/asset_service.h"
#include "server/service/job_service.h"
#include "server/service/messages.h"
#include "server/service/worker_service.h"
#include "server/store/filesystem.h"
#include "server/store/store.h"
#include "tests/integration/service/test_worker.h"

namespace tessera::server {

/// A whole server but for its socket, over a store on disk that outlives it.
class TestServer {
 public:
  TestServer(const std::string& folder, const std::string& token)
      : store_(Store::open(folder, real_filesystem()).value()),
        coordinator_(Coordinator::open(*store_, options()).value()),
        access_(token),
        jobs_(*coordinator_, access_),
        assets_(*coordinator_, access_),
        workers_(*coordinator_, access_) {
    grpc::ServerBuilder builder;
    builder.RegisterService(&jobs_);
    builder.RegisterService(&assets_);
    builder.RegisterService(&workers_);
    server_ = builder.BuildAndStart();
    channel_ = server_->InProcessChannel({});
    writer_ = std::thread([this] {
      while (!coordinator_->is_stopping()) coordinator_->run_writer(true);
    });
    film_ = std::thread([this] {
      while (!coordinator_->is_stopping()) coordinator_->run_film(true);
    });
    timer_ = std::thread([this] {
      while (!coordinator_->is_stopping()) {
        coordinator_->tick();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      }
    });
  }
  ~TestServer() {
    server_->Shutdown(std::chrono::system_clock::now());
    coordinator_->stop();
    for (std::thread* thread : {&writer_, &film_, &timer_}) thread->join();
  }

  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  static CoordinatorOptions options() {
    CoordinatorOptions options;
    options.policy.roster_hold = std::chrono::milliseconds(50);
    options.clock = [] { return std::chrono::steady_clock::now(); };
    options.wall_us = [] { return std::int64_t{1'700'000'000'000'000}; };
    options.random = [state = std::uint64_t{7}]() mutable {
      return state = state * 6364136223846793005u + 1442695040888963407u;
    };
    options.read_spec = read_spec;
    options.write_request = write_request;
    return options;
  }

  std::unique_ptr<Store> store_;
  std::unique_ptr<Coordinator> coordinator_;
  Access access_;
  JobService jobs_;
  AssetService assets_;
  WorkerService workers_;
  std::unique_ptr<grpc::Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::thread writer_, film_, timer_;
};

/// A server that can be restarted, and what a client does with it.
class TestFarm : public testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::remove_all(folder_);
    restart();
  }
  void TearDown() override {
    server_.reset();
    std::filesystem::remove_all(folder_);
  }
  void restart() {
    jobs_.reset();
    assets_.reset();
    server_.reset();
    server_ = std::make_unique<TestServer>(folder_, token_);
    jobs_ = v1::JobService::NewStub(server_->channel());
    assets_ = v1::AssetService::NewStub(server_->channel());
  }

  static void prepare(grpc::ClientContext& context) {
    contract::prepare_call(context, "", std::chrono::seconds(20));
  }
  static v1::AssetId id_of(const std::string& bytes) {
    v1::AssetId id;
    id.set_sha256(contract::sha256(bytes).binary());
    id.set_size_bytes(static_cast<std::int64_t>(bytes.size()));
    return id;
  }
  grpc::Status upload(const v1::AssetId& id, const std::string& bytes) {
    grpc::ClientContext context;
    prepare(context);
    v1::UploadAssetResponse response;
    auto stream = assets_->UploadAsset(&context, &response);
    v1::UploadAssetRequest request;
    *request.mutable_asset() = id;
    stream->Write(request);
    for (std::size_t at = 0; at < bytes.size(); at += 1000) {
      request.set_chunk(bytes.substr(at, 1000));
      if (!stream->Write(request)) break;
    }
    stream->WritesDone();
    return stream->Finish();
  }
  v1::CreateJobRequest request_of(const std::string& name, std::int32_t spp = 16) {
    v1::CreateJobRequest request;
    request.set_request_id("request-" + name);
    request.set_name(name);
    v1::RenderSettings& settings = *request.mutable_settings();
    settings.set_width_px(48);
    settings.set_height_px(40);
    settings.set_tile_px(16);
    settings.set_sample_count(spp);
    settings.set_max_depth(4);
    settings.set_fps(24);
    settings.set_filter_width_px(1);
    settings.set_environment_strength(1);
    v1::FrameRange& range = *settings.add_frames();
    range.set_step(1);
    request.mutable_manifest()->set_scene_uri("scene.gltf");
    v1::ManifestEntry& entry = *request.mutable_manifest()->add_assets();
    entry.set_uri("scene.gltf");
    *entry.mutable_asset() = id_of(kScene);
    return request;
  }
  grpc::Status create(const v1::CreateJobRequest& request, v1::CreateJobResponse& response) {
    grpc::ClientContext context;
    prepare(context);
    return jobs_->CreateJob(&context, request, &response);
  }
  std::string create_job(const std::string& name, std::int32_t spp = 16) {
    EXPECT_TRUE(upload(id_of(kScene), kScene).ok());
    v1::CreateJobResponse response;
    const grpc::Status status = create(request_of(name, spp), response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.job().id();
  }
  /// Every state WatchJob sends until the end.
  std::vector<v1::Job> watch(const std::string& job_id) {
    grpc::ClientContext context;
    prepare(context);
    v1::WatchJobRequest request;
    request.set_job_id(job_id);
    request.mutable_interval()->set_nanos(100'000'000);
    auto stream = jobs_->WatchJob(&context, request);
    std::vector<v1::Job> states;
    for (v1::WatchJobResponse response; stream->Read(&response);) states.push_back(response.job());
    const grpc::Status status = stream->Finish();
    EXPECT_TRUE(status.ok()) << status.error_message();
    return states;
  }
  grpc::Status fetch(const v1::FetchFrameRequest& request, v1::FrameHeader& header,
                     std::string& bytes) {
    grpc::ClientContext context;
    prepare(context);
    auto stream = jobs_->FetchFrame(&context, request);
    for (v1::FetchFrameResponse response; stream->Read(&response);) {
      if (response.has_header()) header = response.header();
      bytes += response.chunk();
    }
    return stream->Finish();
  }
  v1::FrameHeader fetch_exr(const std::string& job_id) {
    v1::FetchFrameRequest request;
    request.set_job_id(job_id);
    v1::FrameHeader header;
    std::string bytes;
    const grpc::Status status = fetch(request, header, bytes);
    EXPECT_TRUE(status.ok()) << status.error_message();
    EXPECT_EQ(contract::sha256(bytes).binary(), header.file_sha256());
    EXPECT_EQ(static_cast<std::int64_t>(bytes.size()), header.size_bytes());
    return header;
  }

  static constexpr char kScene[] = "{\"asset\":{\"version\":\"2.0\"}}";
  const std::string folder_ = testing::TempDir() + "test_farm_" +
                              testing::UnitTest::GetInstance()->current_test_info()->name();
  std::string token_;
  std::unique_ptr<TestServer> server_;
  std::unique_ptr<v1::JobService::Stub> jobs_;
  std::unique_ptr<v1::AssetService::Stub> assets_;
};

}  // namespace tessera::server
