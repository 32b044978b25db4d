#pragma once

#include <grpcpp/channel.h>

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>

namespace tessera::contract {

/// Keeps the connection attempts of a channel going while no call waits on it.
///
/// gRPC processes a connection attempt only while some call waits on its channel, and otherwise
/// every 5 s. A TLS handshake has several steps, so without this a program that retries failed
/// calls reconnects only after half a minute. Unix sockets have no handshake and do not need it.
class ConnectionDriver {
 public:
  explicit ConnectionDriver(std::shared_ptr<grpc::Channel> channel);
  ~ConnectionDriver();
  ConnectionDriver(const ConnectionDriver&) = delete;
  ConnectionDriver& operator=(const ConnectionDriver&) = delete;

 private:
  void run();
  bool wait(std::chrono::milliseconds span);

  const std::shared_ptr<grpc::Channel> channel_;  // owners: this and the channel's stubs
  std::mutex mutex_;
  std::condition_variable wake_;
  bool is_stopping_ = false;
  std::thread thread_;
};

}  // namespace tessera::contract
