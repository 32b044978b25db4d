#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "contract/film_block.h"
#include "contract/tile_grid.h"
#include "rpc/channel.h"
#include "server/service/access/access.h"
#include "server/service/asset_service.h"
#include "server/service/farm_service.h"
#include "server/service/job_service.h"
#include "server/service/worker_service.h"
#include "tests/integration/server/support/made_job.h"
#include "tests/integration/server/support/running_coordinator.h"
#include "tests/integration/server/support/test_worker.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {

/// A whole server except for its socket, over a store on disk, which survives it.
class TestServer {
 public:
  static constexpr std::chrono::seconds kHelloTimeout{2};

  TestServer(const std::string& folder, const std::string& token)
      : running_(folder),
        access_(token),
        admission_(running_.coordinator(), std::nullopt),
        jobs_(running_.coordinator(), access_),
        assets_(running_.coordinator(), access_),
        workers_(running_.coordinator(), access_, admission_, kHelloTimeout),
        farm_(running_.coordinator(), access_) {
    grpc::ServerBuilder builder;
    builder.RegisterService(&jobs_);
    builder.RegisterService(&assets_);
    builder.RegisterService(&workers_);
    builder.RegisterService(&farm_);
    server_ = builder.BuildAndStart();
    channel_ = server_->InProcessChannel({});
  }
  ~TestServer() { server_->Shutdown(std::chrono::system_clock::now()); }

  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  RunningCoordinator running_;
  Access access_;
  WorkerAdmission admission_;
  JobService jobs_;
  AssetService assets_;
  WorkerService workers_;
  FarmService farm_;
  std::unique_ptr<grpc::Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
};

/// A server that can be restarted, and calls of a client.
class TestFarm : public testing::Test {
 protected:
  void SetUp() override { restart(); }
  void TearDown() override { server_.reset(); }
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
  /// Returns whether FindMissingAssets names the asset.
  bool is_missing(const v1::AssetId& id) {
    grpc::ClientContext context;
    prepare(context);
    v1::FindMissingAssetsRequest request;
    *request.add_assets() = id;
    v1::FindMissingAssetsResponse response;
    EXPECT_TRUE(assets_->FindMissingAssets(&context, request, &response).ok());
    return response.missing_size() == 1;
  }
  /// Appends what is received to `bytes`.
  grpc::Status download(const v1::AssetId& id, std::string& bytes) {
    grpc::ClientContext context;
    prepare(context);
    v1::DownloadAssetRequest request;
    *request.mutable_asset() = id;
    auto stream = assets_->DownloadAsset(&context, request);
    for (v1::DownloadAssetResponse response; stream->Read(&response);) bytes += response.chunk();
    return stream->Finish();
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
  /// Returns every state that WatchJob sends until the job ends.
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

  ScratchFolder scratch_;
  const std::string& folder_ = scratch_.path();
  std::string token_;
  std::unique_ptr<TestServer> server_;
  std::unique_ptr<v1::JobService::Stub> jobs_;
  std::unique_ptr<v1::AssetService::Stub> assets_;
};

}  // namespace tessera::server
