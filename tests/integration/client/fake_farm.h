#pragma once

#include <grpcpp/server.h>

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "tessera/v1/job_service.grpc.pb.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::client {

/// A server without workers, over real gRPC on a Unix socket. The test sets its jobs.
class FakeFarm final : public v1::JobService::Service {
 public:
  /// A frame's image, as FetchFrame sends it.
  struct Frame {
    std::string bytes;
    bool finished = true;
    std::vector<v1::PixelRect> missing_tiles;
    bool has_wrong_bytes = false;  // sends bytes that do not match its digest
    int break_count = 0;           // calls to come that are UNAVAILABLE after the first chunk
  };

  FakeFarm();
  ~FakeFarm() override;
  FakeFarm(const FakeFarm&) = delete;
  FakeFarm& operator=(const FakeFarm&) = delete;

  std::string address() const { return "unix:" + (folder_ / "socket").string(); }
  /// A private folder, removed at the end.
  const std::filesystem::path& folder() const { return folder_; }

  // Set by tests, before calls.
  std::vector<v1::Job> jobs;  // oldest first
  std::map<std::string, std::map<std::int32_t, Frame>> frames;
  std::map<std::string, std::string> reports;
  std::vector<v1::Worker> workers;

  v1::Job& add_job(const std::string& id, const std::string& name, v1::Job::State state);

 private:
  class Workers;

  v1::Job* find(const std::string& id);
  grpc::Status change(const std::string& id, v1::Job::State state, v1::Job* reply);

  grpc::Status GetJob(grpc::ServerContext* context, const v1::GetJobRequest* request,
                      v1::GetJobResponse* response) override;
  grpc::Status ListJobs(grpc::ServerContext* context, const v1::ListJobsRequest* request,
                        v1::ListJobsResponse* response) override;
  grpc::Status PauseJob(grpc::ServerContext* context, const v1::PauseJobRequest* request,
                        v1::PauseJobResponse* response) override;
  grpc::Status ResumeJob(grpc::ServerContext* context, const v1::ResumeJobRequest* request,
                         v1::ResumeJobResponse* response) override;
  grpc::Status CancelJob(grpc::ServerContext* context, const v1::CancelJobRequest* request,
                         v1::CancelJobResponse* response) override;
  grpc::Status RetryJob(grpc::ServerContext* context, const v1::RetryJobRequest* request,
                        v1::RetryJobResponse* response) override;
  grpc::Status RemoveJob(grpc::ServerContext* context, const v1::RemoveJobRequest* request,
                         v1::RemoveJobResponse* response) override;
  grpc::Status ExtendJob(grpc::ServerContext* context, const v1::ExtendJobRequest* request,
                         v1::ExtendJobResponse* response) override;
  grpc::Status GetJobReport(grpc::ServerContext* context, const v1::GetJobReportRequest* request,
                            grpc::ServerWriter<v1::GetJobReportResponse>* writer) override;
  grpc::Status FetchFrame(grpc::ServerContext* context, const v1::FetchFrameRequest* request,
                          grpc::ServerWriter<v1::FetchFrameResponse>* writer) override;

  std::filesystem::path folder_;
  std::mutex mutex_;  // guards jobs while the server runs
  std::unique_ptr<v1::WorkerService::Service> worker_service_;
  std::unique_ptr<grpc::Server> server_;
};

/// Exit code and output of a run of the client.
struct Outcome {
  int exit = -1;
  std::string out, err;
};

/// Runs `tessera ARGUMENTS…` in this process and captures stdout and stderr.
Outcome run_client(const std::vector<std::string>& arguments);

}  // namespace tessera::client
