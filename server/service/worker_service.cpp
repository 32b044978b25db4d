#include "server/service/worker_service.h"

#include <algorithm>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "rpc/rpc_status.h"
#include "rpc/settings_message.h"
#include "server/service/finish.h"
#include "server/service/messages/field_checks.h"
#include "server/service/messages/job_messages.h"
#include "server/service/messages/message_budget.h"
#include "server/service/messages/messages.h"
#include "server/service/streams/deliver_stream.h"
#include "server/service/streams/work_stream.h"

namespace tessera::server {
namespace {

constexpr std::int32_t kMaxWorkersPerPage = 100'000;
constexpr std::size_t kMaxReasonLetters = 200;

std::function<void(absl::Status)> answer_with(grpc::ServerUnaryReactor* reactor) {
  return [reactor](const absl::Status& status) { reactor->Finish(contract::to_rpc(status)); };
}

}  // namespace

grpc::ServerBidiReactor<v1::WorkRequest, v1::WorkResponse>* WorkerService::Work(
    grpc::CallbackServerContext* context) {
  return work_stream({coordinator_, access_, admission_, hello_timeout_}, *context,
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
    spec = coordinator_.queries().describe_job(request->job_id(),
                                               is_worker ? caller->certificate() : "");
  }
  if (status.ok() && !spec) {
    status = absl::NotFoundError(absl::StrCat("no job \"", request->job_id(), "\""));
  }
  if (status.ok()) {
    *response->mutable_settings() = contract::to_message(spec->settings);
    *response->mutable_manifest() = to_manifest(*spec);
  }
  return finish(context, status);
}

grpc::ServerUnaryReactor* WorkerService::ListWorkers(grpc::CallbackServerContext* context,
                                                     const v1::ListWorkersRequest* request,
                                                     v1::ListWorkersResponse* response) {
  const absl::Status status = access_.admit(*context, "WorkerService.ListWorkers").status();
  if (!status.ok()) return finish(context, status);
  if (request->page_size() < 0 || request->page_size() > kMaxWorkersPerPage) {
    return finish(context, absl::InvalidArgumentError(
                               absl::StrCat("page_size: ", request->page_size(), " is not in [0, ",
                                            kMaxWorkersPerPage, "]")));
  }
  auto workers = coordinator_.workers().list();
  std::sort(workers.begin(), workers.end(),
            [](const auto& a, const auto& b) { return a.first.id < b.first.id; });
  // The token is the last ID of the page before; a worker that has gone since does no harm.
  auto next = std::upper_bound(
      workers.begin(), workers.end(), request->page_token(),
      [](const std::string& token, const auto& entry) { return token < entry.first.id; });
  const std::int32_t size = request->page_size() == 0 ? kMaxWorkersPerPage : request->page_size();
  MessageBudget budget;
  for (; next != workers.end() && response->workers_size() < size; ++next) {
    v1::Worker worker = to_message(next->first, next->second);
    if (!budget.add(worker)) break;
    *response->add_workers() = std::move(worker);
  }
  if (next != workers.end()) {
    response->set_next_page_token(response->workers(response->workers_size() - 1).id());
  }
  return finish(context, absl::OkStatus());
}

grpc::ServerUnaryReactor* WorkerService::DrainWorker(grpc::CallbackServerContext* context,
                                                     const v1::DrainWorkerRequest* request,
                                                     v1::DrainWorkerResponse* /*response*/) {
  absl::Status status = access_.admit(*context, "WorkerService.DrainWorker").status();
  if (status.ok()) status = coordinator_.workers().drain_worker(request->worker_id());
  return finish(context, status);
}

grpc::ServerUnaryReactor* WorkerService::BanWorker(grpc::CallbackServerContext* context,
                                                   const v1::BanWorkerRequest* request,
                                                   v1::BanWorkerResponse* response) {
  const absl::Status status = access_.admit(*context, "WorkerService.BanWorker").status();
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.workers().ban_worker(request->worker_id(), [reactor, response](const auto& banned) {
    if (banned.ok()) response->mutable_worker_ids()->Add(banned->begin(), banned->end());
    reactor->Finish(contract::to_rpc(banned.status()));
  });
  return reactor;
}

grpc::ServerUnaryReactor* WorkerService::AllowWorker(grpc::CallbackServerContext* context,
                                                     const v1::AllowWorkerRequest* request,
                                                     v1::AllowWorkerResponse* /*response*/) {
  const absl::Status status = access_.admit(*context, "WorkerService.AllowWorker").status();
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.workers().allow_worker(request->worker_id(), answer_with(reactor));
  return reactor;
}

grpc::ServerUnaryReactor* WorkerService::MoveWorker(grpc::CallbackServerContext* context,
                                                    const v1::MoveWorkerRequest* request,
                                                    v1::MoveWorkerResponse* /*response*/) {
  absl::Status status = access_.admit(*context, "WorkerService.MoveWorker").status();
  if (status.ok() && !request->pool().empty()) status = check_name("pool", request->pool());
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.settings().move_worker(request->worker_id(), request->pool(), answer_with(reactor));
  return reactor;
}

grpc::ServerUnaryReactor* WorkerService::SetAsideWorker(grpc::CallbackServerContext* context,
                                                        const v1::SetAsideWorkerRequest* request,
                                                        v1::SetAsideWorkerResponse* /*response*/) {
  absl::Status status = access_.admit(*context, "WorkerService.SetAsideWorker").status();
  if (status.ok()) status = check_text("reason", request->reason(), 0, kMaxReasonLetters);
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.settings().set_aside(request->worker_id(), request->reason(), answer_with(reactor));
  return reactor;
}

grpc::ServerUnaryReactor* WorkerService::BringBackWorker(
    grpc::CallbackServerContext* context, const v1::BringBackWorkerRequest* request,
    v1::BringBackWorkerResponse* /*response*/) {
  const absl::Status status = access_.admit(*context, "WorkerService.BringBackWorker").status();
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.settings().bring_back(request->worker_id(), answer_with(reactor));
  return reactor;
}

}  // namespace tessera::server
