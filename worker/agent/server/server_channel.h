#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <mutex>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "rpc/connection_driver.h"
#include "tessera/v1/asset_service.grpc.pb.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::agent {

/// The channel to the server, which can be reopened while it is used, because a connection keeps
/// the certificate with which it was made. Thread-safe.
class ServerChannel {
 public:
  /// Errors: those of contract::open_channel().
  static absl::StatusOr<std::unique_ptr<ServerChannel>> open(std::string server, std::string certs);
  /// Uses an open channel permanently.
  explicit ServerChannel(std::shared_ptr<grpc::Channel> channel) { use(std::move(channel)); }

  /// Opens a new channel, for later calls. Calls in progress keep theirs. Errors: as open().
  absl::Status reopen();

  std::shared_ptr<grpc::Channel> channel() const;
  std::shared_ptr<v1::WorkerService::Stub> workers() const;
  std::shared_ptr<v1::AssetService::Stub> assets() const;

 private:
  ServerChannel(std::string server, std::string certs)
      : server_(std::move(server)), certs_(std::move(certs)) {}
  void use(std::shared_ptr<grpc::Channel> channel);

  const std::string server_, certs_;
  mutable std::mutex mutex_;  // guards what follows
  std::shared_ptr<grpc::Channel> channel_;
  std::shared_ptr<v1::WorkerService::Stub> workers_;
  std::shared_ptr<v1::AssetService::Stub> assets_;
  std::unique_ptr<contract::ConnectionDriver> driver_;  // null without certificates
};

}  // namespace tessera::agent
