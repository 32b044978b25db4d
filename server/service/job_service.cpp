#include "server/service/job_service.h"

#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/contract/rpc_status.h"
#include "server/observe/report.h"
#include "server/service/frame_stream.h"
#include "server/service/messages.h"
#include "server/service/watch_stream.h"

namespace tessera::server {
namespace {

constexpr char kOwner[] = "local";  // there are no certificates yet to tell one user from another
constexpr std::int32_t kPageSize = 100, kLargestPageSize = 1000;

grpc::ServerUnaryReactor* finish(grpc::CallbackServerContext* context, const absl::Status& status) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(contract::to_rpc(status));
  return reactor;
}

/// Fills in `job` and finishes the call when the coordinator answers.
Coordinator::OnJob answer_with(grpc::ServerUnaryReactor* reactor, v1::Job* job) {
  return [reactor, job](const absl::StatusOr<JobView>& view) {
    if (view.ok()) *job = to_message(*view);
    reactor->Finish(contract::to_rpc(view.status()));
  };
}

}  // namespace

grpc::ServerUnaryReactor* JobService::CreateJob(grpc::CallbackServerContext* context,
                                                const v1::CreateJobRequest* request,
                                                v1::CreateJobResponse* response) {
  if (absl::Status status = access_.check(*context); !status.ok()) return finish(context, status);
  auto spec = to_spec(*request, kOwner);
  if (!spec.ok()) return finish(context, spec.status());
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.create_job(*std::move(spec), [=](const auto& created) {
    if (created.ok()) {
      *response->mutable_job() = to_message(created->view);
      response->set_store_bytes(created->store_bytes);
    }
    reactor->Finish(contract::to_rpc(created.status()));
  });
  return reactor;
}

grpc::ServerUnaryReactor* JobService::GetJob(grpc::CallbackServerContext* context,
                                             const v1::GetJobRequest* request,
                                             v1::GetJobResponse* response) {
  if (absl::Status status = access_.check(*context); !status.ok()) return finish(context, status);
  const auto view = coordinator_.find_job(request->job());
  if (view.ok()) *response->mutable_job() = to_message(*view);
  return finish(context, view.status());
}

grpc::ServerUnaryReactor* JobService::ListJobs(grpc::CallbackServerContext* context,
                                               const v1::ListJobsRequest* request,
                                               v1::ListJobsResponse* response) {
  if (absl::Status status = access_.check(*context); !status.ok()) return finish(context, status);
  JobKey before = 0;
  if (!request->page_token().empty() &&
      (!absl::SimpleAtoi(request->page_token(), &before) || before <= 0)) {
    return finish(context, absl::InvalidArgumentError("page_token: was not given out here"));
  }
  if (request->page_size() < 0 || request->page_size() > kLargestPageSize) {
    return finish(context, absl::InvalidArgumentError(absl::StrCat(
                               "page_size: ", request->page_size(), " is not in [0, 1000]")));
  }
  const std::int32_t size = request->page_size() == 0 ? kPageSize : request->page_size();
  const std::vector<JobView> views = coordinator_.list_jobs(before, size);
  for (const JobView& view : views) *response->add_jobs() = to_message(view);
  if (static_cast<std::int32_t>(views.size()) == size && views.back().key > 1) {
    response->set_next_page_token(absl::StrCat(views.back().key));
  }
  return finish(context, absl::OkStatus());
}

grpc::ServerWriteReactor<v1::WatchJobResponse>* JobService::WatchJob(
    grpc::CallbackServerContext* context, const v1::WatchJobRequest* request) {
  return watch_job(coordinator_, *request, access_.check(*context));
}

grpc::ServerUnaryReactor* JobService::change(grpc::CallbackServerContext* context,
                                             const std::string& job_id, Coordinator::Change change,
                                             v1::Job* job) {
  if (absl::Status status = access_.check(*context); !status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.change_job(job_id, change, answer_with(reactor, job));
  return reactor;
}

grpc::ServerUnaryReactor* JobService::PauseJob(grpc::CallbackServerContext* context,
                                               const v1::PauseJobRequest* request,
                                               v1::PauseJobResponse* response) {
  return change(context, request->job_id(), Coordinator::Change::pause, response->mutable_job());
}

grpc::ServerUnaryReactor* JobService::ResumeJob(grpc::CallbackServerContext* context,
                                                const v1::ResumeJobRequest* request,
                                                v1::ResumeJobResponse* response) {
  return change(context, request->job_id(), Coordinator::Change::resume, response->mutable_job());
}

grpc::ServerUnaryReactor* JobService::CancelJob(grpc::CallbackServerContext* context,
                                                const v1::CancelJobRequest* request,
                                                v1::CancelJobResponse* response) {
  return change(context, request->job_id(), Coordinator::Change::cancel, response->mutable_job());
}

grpc::ServerUnaryReactor* JobService::RetryJob(grpc::CallbackServerContext* context,
                                               const v1::RetryJobRequest* request,
                                               v1::RetryJobResponse* response) {
  return change(context, request->job_id(), Coordinator::Change::retry, response->mutable_job());
}

grpc::ServerUnaryReactor* JobService::RemoveJob(grpc::CallbackServerContext* context,
                                                const v1::RemoveJobRequest* request,
                                                v1::RemoveJobResponse* /*response*/) {
  if (absl::Status status = access_.check(*context); !status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.remove_job(request->job_id(), [reactor](const absl::Status& status) {
    reactor->Finish(contract::to_rpc(status));
  });
  return reactor;
}

grpc::ServerUnaryReactor* JobService::ExtendJob(grpc::CallbackServerContext* context,
                                                const v1::ExtendJobRequest* request,
                                                v1::ExtendJobResponse* response) {
  if (absl::Status status = access_.check(*context); !status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  Coordinator::Extension extension;
  if (request->sample_count() != 0) extension.spp = request->sample_count();
  if (request->has_error_target()) extension.error = request->error_target();
  coordinator_.extend_job(request->job_id(), extension,
                          answer_with(reactor, response->mutable_job()));
  return reactor;
}

grpc::ServerUnaryReactor* JobService::GetJobReport(grpc::CallbackServerContext* context,
                                                   const v1::GetJobReportRequest* request,
                                                   v1::GetJobReportResponse* response) {
  if (absl::Status status = access_.check(*context); !status.ok()) return finish(context, status);
  const auto report = coordinator_.report(request->job_id());
  if (report.ok()) response->set_report_json(report_json(*report));
  return finish(context, report.status());
}

grpc::ServerWriteReactor<v1::FetchFrameResponse>* JobService::FetchFrame(
    grpc::CallbackServerContext* context, const v1::FetchFrameRequest* request) {
  return send_frame(coordinator_, *request, access_.check(*context));
}

}  // namespace tessera::server
