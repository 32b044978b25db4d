#pragma once

#include <grpcpp/server_context.h>

#include <memory>
#include <utility>

namespace tessera::server {

/// The context of a call. It lives until gRPC has called OnDone, however the call ends.
class CallContext final : public grpc::CallbackServerContext {
 public:
  /// Keeps `held` until the call has ended.
  void hold(std::shared_ptr<const void> held) { held_ = std::move(held); }

 private:
  std::shared_ptr<const void> held_;
};

/// Makes the contexts of a server's calls CallContexts.
class CallContexts final : public grpc::ContextAllocator {
 public:
  // The names are those of gRPC.
  // NOLINTBEGIN(readability-identifier-naming)
  grpc::CallbackServerContext* NewCallbackServerContext() override;
  /// For calls of unknown rpcs.
  grpc::GenericCallbackServerContext* NewGenericCallbackServerContext() override;
  void Release(grpc::CallbackServerContext* context) override;
  void Release(grpc::GenericCallbackServerContext* context) override;
  // NOLINTEND(readability-identifier-naming)
};

}  // namespace tessera::server
