#pragma once

#include <grpcpp/client_context.h>
#include <grpcpp/support/client_callback.h>

#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "absl/status/status.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::agent {

/// The control stream, open from construction. `on_closed` is the last callback and called once;
/// destroy the object only after it. Callbacks run on gRPC's threads and must not block.
class WorkStream : private grpc::ClientBidiReactor<v1::WorkRequest, v1::WorkResponse> {
 public:
  struct Listener {
    std::function<void(v1::WorkResponse)> on_response;
    std::function<void(absl::Status)> on_closed;
  };
  WorkStream(v1::WorkerService::Stub& stub, const std::string& token, Listener listener);

  /// Queues a message. Thread-safe.
  void send(v1::WorkRequest request);
  /// Closes the sending side after the queued messages.
  void finish();
  /// Cancels the stream; on_closed follows.
  void cancel() { context_.TryCancel(); }

 private:
  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone(const grpc::Status& status) override;
  void write_next();
  void release_hold();

  grpc::ClientContext context_;
  Listener listener_;
  v1::WorkResponse response_;
  std::mutex mutex_;                   // guards what follows
  std::deque<v1::WorkRequest> queue_;  // front: being written
  bool broken_ = false, finishing_ = false, holding_ = true;
};

/// The stream that delivers blocks. Lifetime rules as for WorkStream.
class DeliverStream : private grpc::ClientWriteReactor<v1::DeliverRequest> {
 public:
  struct Listener {
    std::function<void()> on_room;  // fewer than kMaxQueued messages are queued again
    std::function<void(absl::Status)> on_closed;
  };
  static constexpr std::size_t kMaxQueued = 8;

  DeliverStream(v1::WorkerService::Stub& stub, const std::string& token, Listener listener);

  /// Returns whether another message should be queued. Thread-safe.
  bool has_room();
  void send(v1::DeliverRequest request);
  void finish();
  void cancel();

 private:
  void OnWriteDone(bool ok) override;
  void OnDone(const grpc::Status& status) override;
  void write_next();
  void release_hold();

  grpc::ClientContext context_;
  Listener listener_;
  v1::DeliverResponse response_;
  std::mutex mutex_;                      // guards what follows
  std::deque<v1::DeliverRequest> queue_;  // front: being written
  bool broken_ = false, finishing_ = false, holding_ = true;
};

/// Keepalive probe: a small unary call that tells an idle server from a dead one. Destroy it only
/// after `on_answer`.
class KeepaliveProbe {
 public:
  /// Calls `on_answer` once, on a gRPC thread, with whether the server answered within `timeout`.
  KeepaliveProbe(v1::WorkerService::Stub& stub, const std::string& token,
                 std::chrono::milliseconds timeout, std::function<void(bool)> on_answer);
  void cancel() { context_.TryCancel(); }

 private:
  grpc::ClientContext context_;
  v1::DescribeJobRequest request_;  // names no job
  v1::DescribeJobResponse response_;
};

}  // namespace tessera::agent
