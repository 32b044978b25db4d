#include "server/service/farm_service.h"

#include "absl/strings/str_cat.h"
#include "rpc/rpc_status.h"
#include "server/service/finish.h"
#include "server/service/messages/messages.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kMaxUnits = 1'000'000;

}  // namespace

grpc::ServerUnaryReactor* FarmService::SetLimit(grpc::CallbackServerContext* context,
                                                const v1::SetLimitRequest* request,
                                                v1::SetLimitResponse* response) {
  absl::Status status = access_.admit(*context, "FarmService.SetLimit").status();
  if (status.ok()) status = check_name("name", request->name());
  if (status.ok() && (request->unit_count() < 0 || request->unit_count() > kMaxUnits)) {
    status = absl::InvalidArgumentError(
        absl::StrCat("unit_count: ", request->unit_count(), " is not in [0, ", kMaxUnits, "]"));
  }
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.settings().set_limit(request->name(), request->unit_count(),
                                    [=](const absl::StatusOr<LimitView>& limit) {
                                      if (limit.ok())
                                        *response->mutable_limit() = to_message(*limit);
                                      reactor->Finish(contract::to_rpc(limit.status()));
                                    });
  return reactor;
}

grpc::ServerUnaryReactor* FarmService::RemoveLimit(grpc::CallbackServerContext* context,
                                                   const v1::RemoveLimitRequest* request,
                                                   v1::RemoveLimitResponse* /*response*/) {
  const absl::Status status = access_.admit(*context, "FarmService.RemoveLimit").status();
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.settings().remove_limit(request->name(), [reactor](const absl::Status& removed) {
    reactor->Finish(contract::to_rpc(removed));
  });
  return reactor;
}

grpc::ServerUnaryReactor* FarmService::ListLimits(grpc::CallbackServerContext* context,
                                                  const v1::ListLimitsRequest* /*request*/,
                                                  v1::ListLimitsResponse* response) {
  const absl::Status status = access_.admit(*context, "FarmService.ListLimits").status();
  if (!status.ok()) return finish(context, status);
  for (const LimitView& limit : coordinator_.settings().limits()) {
    *response->add_limits() = to_message(limit);
  }
  return finish(context, absl::OkStatus());
}

}  // namespace tessera::server
