#include "server/service/worker_service.h"

#include "absl/strings/str_cat.h"
#include "proto/contract/rpc_status.h"
#include "proto/contract/settings_message.h"
#include "server/service/deliver_stream.h"
#include "server/service/messages.h"
#include "server/service/work_stream.h"

namespace tessera::server {

grpc::ServerBidiReactor<v1::WorkRequest, v1::WorkResponse>* WorkerService::Work(
    grpc::CallbackServerContext* context) {
  return work_stream({coordinator_, access_, admission_, hello_within_}, *context,
                     access_.admit(*context, "WorkerService.Work"));
}

grpc::ServerReadReactor<v1::DeliverRequest>* WorkerService::Deliver(
    grpc::CallbackServerContext* context, v1::DeliverResponse* /*response*/) {
  return deliver_stream(coordinator_, access_.admit(*context, "WorkerService.Deliver"));
}

grpc::ServerUnaryReactor* WorkerService::DescribeJob(grpc::CallbackServerContext* context,
                                                     const v1::DescribeJobRequest* request,
                                                     v1::DescribeJobResponse* response) {
  const auto caller = access_.admit(*context, "WorkerService.DescribeJob");
  absl::Status status = caller.status();
  std::shared_ptr<const JobSpec> spec;
  if (status.ok()) {
    const bool is_worker = caller->identity && caller->identity->role == Role::worker;
    spec = coordinator_.describe_job(request->job_id(), is_worker ? caller->certificate() : "");
  }
  if (status.ok() && !spec) {
    status = absl::NotFoundError(absl::StrCat("no job \"", request->job_id(), "\""));
  }
  if (status.ok()) {
    *response->mutable_settings() = contract::to_message(spec->settings);
    *response->mutable_manifest() = to_manifest(*spec);
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(contract::to_rpc(status));
  return reactor;
}

grpc::ServerUnaryReactor* WorkerService::ListWorkers(grpc::CallbackServerContext* context,
                                                     const v1::ListWorkersRequest* /*request*/,
                                                     v1::ListWorkersResponse* response) {
  const absl::Status status = access_.admit(*context, "WorkerService.ListWorkers").status();
  if (status.ok()) {
    for (const auto& [worker, silence] : coordinator_.workers()) {
      *response->add_workers() = to_message(worker, silence);
    }
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(contract::to_rpc(status));
  return reactor;
}

}  // namespace tessera::server
