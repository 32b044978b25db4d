#include "server/service/quotas/call_context.h"

#include <grpcpp/generic/async_generic_service.h>

namespace tessera::server {

grpc::CallbackServerContext* CallContexts::NewCallbackServerContext() {
  return new CallContext;
}

// If this returned null, gRPC would make a context itself, and pass it to Release() nevertheless.
grpc::GenericCallbackServerContext* CallContexts::NewGenericCallbackServerContext() {
  return new grpc::GenericCallbackServerContext;
}

void CallContexts::Release(grpc::CallbackServerContext* context) {
  delete context;
}
void CallContexts::Release(grpc::GenericCallbackServerContext* context) {
  delete context;
}

}  // namespace tessera::server
