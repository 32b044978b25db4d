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

/// The control stream. Made open; `on_closed` is called once, last, and only then may the object be
/// destroyed. Callbacks run on gRPC's threads and must not block.
class WorkStream : private grpc::ClientBidiReactor<v1::WorkRequest, v1::WorkResponse> {
 public:
  struct Listener {
    std::function<void(v1::WorkResponse)> on_response;
    std::function<void(absl::Status)> on_closed;
  };
  WorkStream(v1::WorkerService::Stub& stub, const std::string& token, Listener listener);

  /// Queues a message. Any thread.
  void send(v1::WorkRequest request);
  /// Says that no more messages come, after those queued.
  void finish();
  /// Ends the stream now; on_closed follows.
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

/// The stream that carries blocks. Rules of life as WorkStream's.
class DeliverStream : private grpc::ClientWriteReactor<v1::DeliverRequest> {
 public:
  struct Listener {
    std::function<void()> on_room;  // fewer than kMaxQueued messages wait again
    std::function<void(absl::Status)> on_closed;
  };
  static constexpr std::size_t kMaxQueued = 8;

  DeliverStream(v1::WorkerService::Stub& stub, const std::string& token, Listener listener);

  /// Whether another message should be queued. Any thread.
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

/// A small question to the server, for its answer as a sign of life: what the server has nothing to
/// say about it does not say, and a long silence may be either. Destroy it only after `on_answer`.
class KeepaliveProbe {
 public:
  /// `on_answer(true)`: the server answered within `timeout`. Called once, on a thread of gRPC's.
  KeepaliveProbe(v1::WorkerService::Stub& stub, const std::string& token,
           std::chrono::milliseconds timeout, std::function<void(bool)> on_answer);
  void cancel() { context_.TryCancel(); }

 private:
  grpc::ClientContext context_;
  v1::DescribeJobRequest request_;  // of no job
  v1::DescribeJobResponse response_;
};

}  // namespace tessera::agent
