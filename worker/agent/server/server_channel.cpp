#include "worker/agent/server/server_channel.h"

#include <utility>

#include "rpc/channel.h"

namespace tessera::agent {

absl::StatusOr<std::unique_ptr<ServerChannel>> ServerChannel::open(std::string server,
                                                                   std::string certs) {
  std::unique_ptr<ServerChannel> opened(new ServerChannel(std::move(server), std::move(certs)));
  if (absl::Status status = opened->reopen(); !status.ok()) return status;
  return opened;
}

absl::Status ServerChannel::reopen() {
  auto channel = contract::open_channel(server_, certs_);
  if (channel.ok()) use(*std::move(channel));
  return channel.status();
}

void ServerChannel::use(std::shared_ptr<grpc::Channel> channel) {
  auto driver = certs_.empty() ? nullptr : std::make_unique<contract::ConnectionDriver>(channel);
  const std::lock_guard lock(mutex_);
  workers_ = v1::WorkerService::NewStub(channel);
  assets_ = v1::AssetService::NewStub(channel);
  channel_ = std::move(channel);
  driver_.swap(driver);  // the old one ends after the lock is released
}

std::shared_ptr<grpc::Channel> ServerChannel::channel() const {
  const std::lock_guard lock(mutex_);
  return channel_;
}

std::shared_ptr<v1::WorkerService::Stub> ServerChannel::workers() const {
  const std::lock_guard lock(mutex_);
  return workers_;
}

std::shared_ptr<v1::AssetService::Stub> ServerChannel::assets() const {
  const std::lock_guard lock(mutex_);
  return assets_;
}

}  // namespace tessera::agent
