#pragma once

#include <chrono>
#include <string>
#include <string_view>

#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "server/sync/io_pool.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// gRPC front end of jobs: checks and converts messages, maps errors.
class JobService final : public v1::JobService::CallbackService {
 public:
  /// Both must outlive the server this is registered with.
  JobService(Coordinator& coordinator, const Access& access)
      : coordinator_(coordinator), access_(access) {}

  grpc::ServerUnaryReactor* CreateJob(grpc::CallbackServerContext* context,
                                      const v1::CreateJobRequest* request,
                                      v1::CreateJobResponse* response) override;
  grpc::ServerUnaryReactor* GetJob(grpc::CallbackServerContext* context,
                                   const v1::GetJobRequest* request,
                                   v1::GetJobResponse* response) override;
  grpc::ServerUnaryReactor* ListJobs(grpc::CallbackServerContext* context,
                                     const v1::ListJobsRequest* request,
                                     v1::ListJobsResponse* response) override;
  grpc::ServerWriteReactor<v1::WatchJobResponse>* WatchJob(
      grpc::CallbackServerContext* context, const v1::WatchJobRequest* request) override;
  grpc::ServerUnaryReactor* PauseJob(grpc::CallbackServerContext* context,
                                     const v1::PauseJobRequest* request,
                                     v1::PauseJobResponse* response) override;
  grpc::ServerUnaryReactor* ResumeJob(grpc::CallbackServerContext* context,
                                      const v1::ResumeJobRequest* request,
                                      v1::ResumeJobResponse* response) override;
  grpc::ServerUnaryReactor* CancelJob(grpc::CallbackServerContext* context,
                                      const v1::CancelJobRequest* request,
                                      v1::CancelJobResponse* response) override;
  grpc::ServerUnaryReactor* RetryJob(grpc::CallbackServerContext* context,
                                     const v1::RetryJobRequest* request,
                                     v1::RetryJobResponse* response) override;
  grpc::ServerUnaryReactor* RemoveJob(grpc::CallbackServerContext* context,
                                      const v1::RemoveJobRequest* request,
                                      v1::RemoveJobResponse* response) override;
  grpc::ServerUnaryReactor* ExtendJob(grpc::CallbackServerContext* context,
                                      const v1::ExtendJobRequest* request,
                                      v1::ExtendJobResponse* response) override;
  grpc::ServerUnaryReactor* UpdateJob(grpc::CallbackServerContext* context,
                                      const v1::UpdateJobRequest* request,
                                      v1::UpdateJobResponse* response) override;
  grpc::ServerWriteReactor<v1::GetJobReportResponse>* GetJobReport(
      grpc::CallbackServerContext* context, const v1::GetJobReportRequest* request) override;
  grpc::ServerUnaryReactor* ListDeliveries(grpc::CallbackServerContext* context,
                                           const v1::ListDeliveriesRequest* request,
                                           v1::ListDeliveriesResponse* response) override;
  grpc::ServerWriteReactor<v1::FetchFrameResponse>* FetchFrame(
      grpc::CallbackServerContext* context, const v1::FetchFrameRequest* request) override;
  grpc::ServerWriteReactor<v1::WatchEventsResponse>* WatchEvents(
      grpc::CallbackServerContext* context, const v1::WatchEventsRequest* request) override;

 private:
  struct Change {
    const char* rpc;
    JobAdmin::Change change;
  };
  grpc::ServerUnaryReactor* change(grpc::CallbackServerContext* context, const std::string& job_id,
                                   const Change& change, v1::Job* job);
  absl::StatusOr<Caller> admit(grpc::CallbackServerContext& context, std::string_view rpc,
                               const std::string& job_id) const;

  Coordinator& coordinator_;
  const Access& access_;
  IoPool io_{2};  // reads images and old events
};

}  // namespace tessera::server
