#pragma once

#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "tessera/v1/farm_service.grpc.pb.h"

namespace tessera::server {

/// gRPC front end of the farm's settings: checks and converts messages, maps errors.
class FarmService final : public v1::FarmService::CallbackService {
 public:
  /// Both must outlive the server this is registered with.
  FarmService(Coordinator& coordinator, const Access& access)
      : coordinator_(coordinator), access_(access) {}

  grpc::ServerUnaryReactor* SetLimit(grpc::CallbackServerContext* context,
                                     const v1::SetLimitRequest* request,
                                     v1::SetLimitResponse* response) override;
  grpc::ServerUnaryReactor* RemoveLimit(grpc::CallbackServerContext* context,
                                        const v1::RemoveLimitRequest* request,
                                        v1::RemoveLimitResponse* response) override;
  grpc::ServerUnaryReactor* ListLimits(grpc::CallbackServerContext* context,
                                       const v1::ListLimitsRequest* request,
                                       v1::ListLimitsResponse* response) override;

 private:
  Coordinator& coordinator_;
  const Access& access_;
};

}  // namespace tessera::server
