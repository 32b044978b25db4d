#pragma once

#include <gtest/gtest.h>

#include <ctime>
#include <fstream>
#include <memory>
#include <mutex>
#include <string>

#include "rpc/channel.h"
#include "server/identity/authority.h"
#include "server/identity/join_tokens.h"
#include "server/service/server.h"
#include "tessera/v1/asset_service.grpc.pb.h"
#include "tessera/v1/job_service.grpc.pb.h"
#include "tests/integration/server/support/made_job.h"
#include "tests/integration/server/support/running_coordinator.h"
#include "tests/integration/server/support/test_worker.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {

/// A server on loopback TCP with certificates for itself and its callers.
class SecureFarm : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(make_authority(certs_, year()).ok());
    ASSERT_TRUE(issue_server(certs_, {"127.0.0.1"}, year()).ok());
    for (const char* name : {"ann", "bob"}) issue_to(Role::client, name);
    for (const char* name : {"w1", "w2"}) issue_to(Role::worker, name);
    issue_to(Role::admin, "root");
    running_ = std::make_unique<RunningCoordinator>(
        store_, [this](LogLevel, const std::string& line) { note(line); }, quotas_);
    auto server = start_server(certs_);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
  }
  void TearDown() override {
    server_.reset();
    running_.reset();
  }

  /// Ends the server and its coordinator and starts them again.
  void restart() {
    server_.reset();
    running_.reset();  // only one process may hold the store
    running_ = std::make_unique<RunningCoordinator>(
        store_, [this](LogLevel, const std::string& line) { note(line); }, quotas_);
    server_ = start_server(certs_).value();
  }

  static Validity year() {
    const std::int64_t now = std::time(nullptr);
    return {now - 60, now + 365 * 86'400};
  }
  std::string certs_of(const std::string& name) const { return folder_ + "/" + name; }
  void issue_to(Role role, const std::string& name) const {
    ASSERT_TRUE(issue(certs_, role, name, certs_of(name), year()).ok()) << name;
  }
  absl::StatusOr<std::unique_ptr<FarmServer>> start_server(const std::string& certs) {
    return FarmServer::start(running_->coordinator(), {"127.0.0.1:0", store_, certs, quotas_});
  }

  /// A new connection under the certificate issued to `name`.
  std::shared_ptr<grpc::Channel> channel(const std::string& name) const {
    return contract::open_channel(server_->address(), certs_of(name)).value();
  }
  std::unique_ptr<v1::JobService::Stub> jobs(const std::string& name) const {
    return v1::JobService::NewStub(channel(name));
  }
  static void prepare(grpc::ClientContext& context) {
    contract::prepare_call(context, "", std::chrono::seconds(20));
  }
  /// Returns the status of the simplest call under that certificate.
  static grpc::Status try_call(const std::shared_ptr<grpc::Channel>& channel) {
    grpc::ClientContext context;
    prepare(context);
    v1::ListJobsResponse response;
    return v1::JobService::NewStub(channel)->ListJobs(&context, {}, &response);
  }
  grpc::Status try_call(const std::string& name) const { return try_call(channel(name)); }

  grpc::Status upload_scene(const std::string& name) const { return upload(name, kScene); }
  grpc::Status upload(const std::string& name, const std::string& bytes) const {
    grpc::ClientContext context;
    prepare(context);
    v1::UploadAssetResponse response;
    const auto assets = v1::AssetService::NewStub(channel(name));
    auto stream = assets->UploadAsset(&context, &response);
    v1::UploadAssetRequest request;
    *request.mutable_asset() = id_of(bytes);
    stream->Write(request);
    request.set_chunk(bytes);
    stream->Write(request);
    stream->WritesDone();
    return stream->Finish();
  }
  grpc::Status download_scene(const std::string& name) const {
    grpc::ClientContext context;
    prepare(context);
    v1::DownloadAssetRequest request;
    *request.mutable_asset() = id_of(kScene);
    const auto assets = v1::AssetService::NewStub(channel(name));
    auto stream = assets->DownloadAsset(&context, request);
    for (v1::DownloadAssetResponse response; stream->Read(&response);) {
    }
    return stream->Finish();
  }
  grpc::Status create(const std::string& name, const v1::CreateJobRequest& request,
                      v1::CreateJobResponse& response) const {
    grpc::ClientContext context;
    prepare(context);
    return jobs(name)->CreateJob(&context, request, &response);
  }
  /// Creates a job for the client `owner`; returns its id.
  std::string create_job(const std::string& owner, const std::string& name) const {
    EXPECT_TRUE(upload_scene(owner).ok());
    v1::CreateJobResponse response;
    const grpc::Status status = create(owner, request_of(name), response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.job().id();
  }

  /// Creates a join token; returns its text.
  std::string token(std::int64_t seconds = 3600, std::int64_t max_joins = 0) const {
    return JoinTokens(store_).create(std::time(nullptr) + seconds, max_joins).value();
  }
  std::unique_ptr<TestWorker> worker(const std::string& certificate, const std::string& id,
                                     const std::string& token) const {
    auto worker = std::make_unique<TestWorker>(channel(certificate), id);
    worker->token = token;
    return worker;
  }
  /// Connects a worker; returns OK if the server welcomes it.
  grpc::Status join(const std::string& certificate, const std::string& id,
                    const std::string& token) const {
    const auto joining = worker(certificate, id, token);
    if (joining->open()) return grpc::Status::OK;
    return joining->close();
  }

  std::string log() {
    const std::lock_guard lock(mutex_);
    return log_;
  }

  ScratchFolder scratch_;
  const std::string& folder_ = scratch_.path();
  const std::string certs_ = folder_ + "/farm", store_ = folder_ + "/store";
  ClientQuotas quotas_;
  std::unique_ptr<RunningCoordinator> running_;
  std::unique_ptr<FarmServer> server_;

 private:
  void note(const std::string& line) {
    const std::lock_guard lock(mutex_);
    log_ += line + "\n";
  }

  std::mutex mutex_;
  std::string log_;
};

}  // namespace tessera::server
