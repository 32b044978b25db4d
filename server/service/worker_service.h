#pragma once

#include "server/coordinator.h"
#include "server/service/access.h"
#include "server/service/worker_admission.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::server {

/// WorkerService on the wire. Checks, translates, maps errors; decides nothing.
class WorkerService final : public v1::WorkerService::CallbackService {
 public:
  /// All must outlive the server this is registered with.
  WorkerService(Coordinator& coordinator, const Access& access, const WorkerAdmission& admission)
      : coordinator_(coordinator), access_(access), admission_(admission) {}

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

 private:
  Coordinator& coordinator_;
  const Access& access_;
  const WorkerAdmission& admission_;
};

}  // namespace tessera::server
