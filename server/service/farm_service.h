#pragma once

#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "server/sync/io_pool.h"
#include "tessera/v1/farm_service.grpc.pb.h"

namespace tessera::server {

/// gRPC front end of the farm's settings and accounts: checks and converts messages, maps errors.
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
  grpc::ServerUnaryReactor* SetShare(grpc::CallbackServerContext* context,
                                     const v1::SetShareRequest* request,
                                     v1::SetShareResponse* response) override;
  grpc::ServerUnaryReactor* ResetShare(grpc::CallbackServerContext* context,
                                       const v1::ResetShareRequest* request,
                                       v1::ResetShareResponse* response) override;
  grpc::ServerUnaryReactor* ListShares(grpc::CallbackServerContext* context,
                                       const v1::ListSharesRequest* request,
                                       v1::ListSharesResponse* response) override;
  grpc::ServerUnaryReactor* SetBudget(grpc::CallbackServerContext* context,
                                      const v1::SetBudgetRequest* request,
                                      v1::SetBudgetResponse* response) override;
  grpc::ServerUnaryReactor* RemoveBudget(grpc::CallbackServerContext* context,
                                         const v1::RemoveBudgetRequest* request,
                                         v1::RemoveBudgetResponse* response) override;
  grpc::ServerUnaryReactor* ListBudgets(grpc::CallbackServerContext* context,
                                        const v1::ListBudgetsRequest* request,
                                        v1::ListBudgetsResponse* response) override;
  grpc::ServerUnaryReactor* ListUsage(grpc::CallbackServerContext* context,
                                      const v1::ListUsageRequest* request,
                                      v1::ListUsageResponse* response) override;
  grpc::ServerUnaryReactor* ListQuotas(grpc::CallbackServerContext* context,
                                       const v1::ListQuotasRequest* request,
                                       v1::ListQuotasResponse* response) override;

 private:
  v1::ClientQuotas quotas_of(const std::string& client, const OwnerUse& use) const;

  Coordinator& coordinator_;
  const Access& access_;
  IoPool io_{1};  // reads accounts
};

}  // namespace tessera::server
