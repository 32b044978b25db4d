#include "server/service/job_service.h"

#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "rpc/rpc_status.h"
#include "server/report/report.h"
#include "server/service/access/protocol_check.h"
#include "server/service/finish.h"
#include "server/service/messages/job_messages.h"
#include "server/service/messages/message_budget.h"
#include "server/service/messages/messages.h"
#include "server/service/streams/event_stream.h"
#include "server/service/streams/frame_stream.h"
#include "server/service/streams/report_stream.h"
#include "server/service/streams/watch_stream.h"

namespace tessera::server {
namespace {

constexpr std::int32_t kPageSize = 100, kMaxPageSize = 1000;
constexpr std::int32_t kMaxDeliveries = 10'000;  // per page: keeps messages below 1 MiB

/// Sets `job` and finishes the call when the coordinator is done.
JobAdmin::OnJob answer_with(grpc::ServerUnaryReactor* reactor, v1::Job* job) {
  return [reactor, job](const absl::StatusOr<JobView>& view) {
    if (view.ok()) *job = to_message(*view);
    reactor->Finish(contract::to_rpc(view.status()));
  };
}

}  // namespace

/// Identifies the caller and checks that it may call `rpc` for this job.
absl::StatusOr<Caller> JobService::admit(grpc::CallbackServerContext& context, std::string_view rpc,
                                         const std::string& job_id) const {
  auto caller = access_.admit(context, rpc);
  if (!caller.ok()) return caller;
  absl::Status status = coordinator_.queries().check_owner(job_id, caller->visible_owner());
  if (!status.ok()) return status;
  return caller;
}

grpc::ServerUnaryReactor* JobService::CreateJob(grpc::CallbackServerContext* context,
                                                const v1::CreateJobRequest* request,
                                                v1::CreateJobResponse* response) {
  const auto caller = access_.admit(*context, "JobService.CreateJob");
  if (!caller.ok()) return finish(context, caller.status());
  if (absl::Status status = check_protocol("client", request->protocol_version()); !status.ok()) {
    return finish(context, status);
  }
  auto spec = to_spec(*request, caller->owner());
  if (!spec.ok()) return finish(context, spec.status());
  if (!caller->visible_owner().empty()) {  // not an admin
    const absl::Status allowed = coordinator_.admission().check_client_priority(spec->priority);
    if (!allowed.ok()) return finish(context, allowed);
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  const auto answer = [=](const absl::StatusOr<JobAdmission::Created>& created) {
    if (created.ok()) {
      *response->mutable_job() = to_message(created->view);
      response->set_store_bytes(created->store_bytes);
    }
    reactor->Finish(contract::to_rpc(created.status()));
  };
  coordinator_.admission().create_job(*std::move(spec), answer, caller->visible_owner());
  return reactor;
}

grpc::ServerUnaryReactor* JobService::GetJob(grpc::CallbackServerContext* context,
                                             const v1::GetJobRequest* request,
                                             v1::GetJobResponse* response) {
  const auto caller = access_.admit(*context, "JobService.GetJob");
  if (!caller.ok()) return finish(context, caller.status());
  const auto view = coordinator_.queries().find_job(request->job(), caller->visible_owner());
  if (view.ok()) *response->mutable_job() = to_message(*view);
  return finish(context, view.status());
}

grpc::ServerUnaryReactor* JobService::ListJobs(grpc::CallbackServerContext* context,
                                               const v1::ListJobsRequest* request,
                                               v1::ListJobsResponse* response) {
  const auto caller = access_.admit(*context, "JobService.ListJobs");
  if (!caller.ok()) return finish(context, caller.status());
  JobKey before = 0;
  if (!request->page_token().empty() &&
      (!absl::SimpleAtoi(request->page_token(), &before) || before <= 0)) {
    return finish(context, absl::InvalidArgumentError("page_token: not a token of this server"));
  }
  if (request->page_size() < 0 || request->page_size() > kMaxPageSize) {
    return finish(context, absl::InvalidArgumentError(absl::StrCat(
                               "page_size: ", request->page_size(), " is not in [0, 1000]")));
  }
  auto filter = to_filter(*request);
  if (!filter.ok()) return finish(context, filter.status());
  filter->visible_owner = caller->visible_owner();
  const std::int32_t size = request->page_size() == 0 ? kPageSize : request->page_size();
  const JobPage page = coordinator_.queries().list_jobs(before, size, *filter);
  MessageBudget budget;
  JobKey next = page.before, last_sent = 0;
  for (const JobView& view : page.jobs) {
    v1::Job job = to_message(view);
    if (!budget.add(job)) {
      next = last_sent;
      break;
    }
    last_sent = view.key;
    *response->add_jobs() = std::move(job);
  }
  if (next != 0) response->set_next_page_token(absl::StrCat(next));
  return finish(context, absl::OkStatus());
}

grpc::ServerWriteReactor<v1::WatchJobResponse>* JobService::WatchJob(
    grpc::CallbackServerContext* context, const v1::WatchJobRequest* request) {
  return watch_job(coordinator_, access_, *request,
                   admit(*context, "JobService.WatchJob", request->job_id()));
}

grpc::ServerUnaryReactor* JobService::change(grpc::CallbackServerContext* context,
                                             const std::string& job_id, const Change& change,
                                             v1::Job* job) {
  const auto caller = admit(*context, change.rpc, job_id);
  if (!caller.ok()) return finish(context, caller.status());
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.jobs().change_job(job_id, change.change, answer_with(reactor, job));
  return reactor;
}

grpc::ServerUnaryReactor* JobService::PauseJob(grpc::CallbackServerContext* context,
                                               const v1::PauseJobRequest* request,
                                               v1::PauseJobResponse* response) {
  return change(context, request->job_id(), {"JobService.PauseJob", JobAdmin::Change::pause},
                response->mutable_job());
}

grpc::ServerUnaryReactor* JobService::ResumeJob(grpc::CallbackServerContext* context,
                                                const v1::ResumeJobRequest* request,
                                                v1::ResumeJobResponse* response) {
  return change(context, request->job_id(), {"JobService.ResumeJob", JobAdmin::Change::resume},
                response->mutable_job());
}

grpc::ServerUnaryReactor* JobService::CancelJob(grpc::CallbackServerContext* context,
                                                const v1::CancelJobRequest* request,
                                                v1::CancelJobResponse* response) {
  return change(context, request->job_id(), {"JobService.CancelJob", JobAdmin::Change::cancel},
                response->mutable_job());
}

grpc::ServerUnaryReactor* JobService::RetryJob(grpc::CallbackServerContext* context,
                                               const v1::RetryJobRequest* request,
                                               v1::RetryJobResponse* response) {
  return change(context, request->job_id(), {"JobService.RetryJob", JobAdmin::Change::retry},
                response->mutable_job());
}

grpc::ServerUnaryReactor* JobService::RemoveJob(grpc::CallbackServerContext* context,
                                                const v1::RemoveJobRequest* request,
                                                v1::RemoveJobResponse* /*response*/) {
  const auto caller = admit(*context, "JobService.RemoveJob", request->job_id());
  if (!caller.ok()) return finish(context, caller.status());
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.jobs().remove_job(request->job_id(), [reactor](const absl::Status& status) {
    reactor->Finish(contract::to_rpc(status));
  });
  return reactor;
}

grpc::ServerUnaryReactor* JobService::ExtendJob(grpc::CallbackServerContext* context,
                                                const v1::ExtendJobRequest* request,
                                                v1::ExtendJobResponse* response) {
  const auto caller = admit(*context, "JobService.ExtendJob", request->job_id());
  if (!caller.ok()) return finish(context, caller.status());
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  JobAdmin::Extension extension;
  if (request->sample_count() != 0) extension.spp = request->sample_count();
  if (request->has_error_target()) extension.error = request->error_target();
  coordinator_.jobs().extend_job(request->job_id(), extension,
                                 answer_with(reactor, response->mutable_job()));
  return reactor;
}

grpc::ServerUnaryReactor* JobService::UpdateJob(grpc::CallbackServerContext* context,
                                                const v1::UpdateJobRequest* request,
                                                v1::UpdateJobResponse* response) {
  const auto caller = admit(*context, "JobService.UpdateJob", request->job_id());
  if (!caller.ok()) return finish(context, caller.status());
  const auto update = from_message(*request);
  if (!update.ok()) return finish(context, update.status());
  if (update->priority && !caller->visible_owner().empty()) {  // not an admin
    const absl::Status allowed = coordinator_.admission().check_client_priority(*update->priority);
    if (!allowed.ok()) return finish(context, allowed);
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.jobs().update_job(request->job_id(), *update,
                                 answer_with(reactor, response->mutable_job()));
  return reactor;
}

grpc::ServerWriteReactor<v1::GetJobReportResponse>* JobService::GetJobReport(
    grpc::CallbackServerContext* context, const v1::GetJobReportRequest* request) {
  const auto caller = admit(*context, "JobService.GetJobReport", request->job_id());
  return send_report(io_, caller, [this, id = request->job_id()]() -> absl::StatusOr<std::string> {
    const auto report = coordinator_.queries().report(id);
    if (!report.ok()) return report.status();
    return report_json(*report);
  });
}

grpc::ServerUnaryReactor* JobService::ListDeliveries(grpc::CallbackServerContext* context,
                                                     const v1::ListDeliveriesRequest* request,
                                                     v1::ListDeliveriesResponse* response) {
  const auto caller = admit(*context, "JobService.ListDeliveries", request->job_id());
  if (!caller.ok()) return finish(context, caller.status());
  std::int64_t after = 0;
  if (!request->page_token().empty() &&
      (!absl::SimpleAtoi(request->page_token(), &after) || after <= 0)) {
    return finish(context, absl::InvalidArgumentError("page_token: not a token of this server"));
  }
  if (request->page_size() < 0 || request->page_size() > kMaxDeliveries) {
    return finish(context,
                  absl::InvalidArgumentError(absl::StrCat("page_size: ", request->page_size(),
                                                          " is not in [0, ", kMaxDeliveries, "]")));
  }
  const std::int32_t size = request->page_size() == 0 ? kMaxDeliveries : request->page_size();
  const auto deliveries =
      coordinator_.queries().deliveries(request->job_id(), after, static_cast<std::size_t>(size));
  if (!deliveries.ok()) return finish(context, deliveries.status());
  for (const Delivery& delivery : *deliveries) *response->add_deliveries() = to_message(delivery);
  if (static_cast<std::int32_t>(deliveries->size()) == size) {
    response->set_next_page_token(absl::StrCat(deliveries->back().sequence));
  }
  return finish(context, absl::OkStatus());
}

grpc::ServerWriteReactor<v1::FetchFrameResponse>* JobService::FetchFrame(
    grpc::CallbackServerContext* context, const v1::FetchFrameRequest* request) {
  return send_frame(coordinator_, io_, *request,
                    admit(*context, "JobService.FetchFrame", request->job_id()));
}

grpc::ServerWriteReactor<v1::WatchEventsResponse>* JobService::WatchEvents(
    grpc::CallbackServerContext* context, const v1::WatchEventsRequest* request) {
  auto caller = request->job_id().empty()
                    ? access_.admit(*context, "JobService.WatchEvents")
                    : admit(*context, "JobService.WatchEvents", request->job_id());
  return watch_events(coordinator_, access_, io_, *request, caller);
}

}  // namespace tessera::server
