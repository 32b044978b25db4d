#pragma once

#include <chrono>

#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "server/service/access/worker_admission.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::server {

/// gRPC front end of workers: checks and converts messages, maps errors.
class WorkerService final : public v1::WorkerService::CallbackService {
 public:
  /// All must outlive the server that this is registered with. `hello_timeout`: time for a Work
  /// stream's first message.
  WorkerService(Coordinator& coordinator, const Access& access, WorkerAdmission& admission,
                std::chrono::milliseconds hello_timeout = std::chrono::seconds(10))
      : coordinator_(coordinator),
        access_(access),
        admission_(admission),
        hello_timeout_(hello_timeout) {}

  grpc::ServerBidiReactor<v1::WorkRequest, v1::WorkResponse>* Work(
      grpc::CallbackServerContext* context) override;
  grpc::ServerReadReactor<v1::DeliverRequest>* Deliver(grpc::CallbackServerContext* context,
                                                       v1::DeliverResponse* response) override;
  grpc::ServerUnaryReactor* DescribeJob(grpc::CallbackServerContext* context,
                                        const v1::DescribeJobRequest* request,
                                        v1::DescribeJobResponse* response) override;
  grpc::ServerUnaryReactor* ListWorkers(grpc::CallbackServerContext* context,
                                        const v1::ListWorkersRequest* request,
                                        v1::ListWorkersResponse* response) override;
  grpc::ServerUnaryReactor* DrainWorker(grpc::CallbackServerContext* context,
                                        const v1::DrainWorkerRequest* request,
                                        v1::DrainWorkerResponse* response) override;
  grpc::ServerUnaryReactor* BanWorker(grpc::CallbackServerContext* context,
                                      const v1::BanWorkerRequest* request,
                                      v1::BanWorkerResponse* response) override;
  grpc::ServerUnaryReactor* AllowWorker(grpc::CallbackServerContext* context,
                                        const v1::AllowWorkerRequest* request,
                                        v1::AllowWorkerResponse* response) override;
  grpc::ServerUnaryReactor* MoveWorker(grpc::CallbackServerContext* context,
                                       const v1::MoveWorkerRequest* request,
                                       v1::MoveWorkerResponse* response) override;
  grpc::ServerUnaryReactor* SetAsideWorker(grpc::CallbackServerContext* context,
                                           const v1::SetAsideWorkerRequest* request,
                                           v1::SetAsideWorkerResponse* response) override;
  grpc::ServerUnaryReactor* BringBackWorker(grpc::CallbackServerContext* context,
                                            const v1::BringBackWorkerRequest* request,
                                            v1::BringBackWorkerResponse* response) override;

 private:
  Coordinator& coordinator_;
  const Access& access_;
  WorkerAdmission& admission_;
  const std::chrono::milliseconds hello_timeout_;
};

}  // namespace tessera::server
