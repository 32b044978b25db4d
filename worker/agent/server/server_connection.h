#pragma once

#include <grpcpp/channel.h>

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rpc/backoff.h"
#include "telemetry/log/log.h"
#include "worker/agent/server/server_channel.h"
#include "worker/agent/server/worker_streams.h"
#include "worker/agent/units/event_loop.h"
#include "worker/agent/units/unit_queue.h"

namespace tessera::agent {

/// The worker's two streams to its server. Opens them, sends Hello, heartbeats and blocks, and
/// reconnects with exponential back-off and jitter when a stream breaks or the server is silent.
///
/// All calls are on the agent's thread; gRPC's callbacks arrive through the event loop.
/// See docs/reference/protocol.md.
class ServerConnection {
 public:
  struct Options {
    std::string token;  // sent until the server issues a session key
    /// FaultHooks::blocks_to_send; empty: each block is sent once.
    std::function<std::vector<UnitQueue::Block>(UnitQueue::Block)> blocks_to_send;
    /// Returns whether a refusal may be due to a certificate that has expired and will be replaced,
    /// so that it is not final. May be empty.
    std::function<bool()> awaits_certificate;
    Log log = no_log;
  };
  struct Callbacks {
    std::function<v1::WorkerHello()> hello;             // without the units, which the queue adds
    std::function<CreditWindow()> window;               // current limits
    std::function<std::int64_t()> rss_bytes;            // for heartbeats
    std::function<void(v1::WorkResponse)> on_response;  // all responses but Welcome
    std::function<void(absl::Status)> refused;          // final: no reconnection
  };

  /// All references must outlive the connection.
  ServerConnection(ServerChannel& channel, Options options, UnitQueue& queue, EventLoop& event_loop,
                   Callbacks callbacks);

  /// Connects, sends heartbeats and delivers blocks as due. Call after every change and at
  /// next_due().
  void pump(Time now);
  Time next_due() const;
  /// Queues a message. Without a connection it is dropped: the next Hello contains the full state.
  void send(v1::WorkRequest request);
  bool connected() const { return welcomed_; }
  /// Ends both streams and opens new ones, on the channel's present connection. Nothing is lost:
  /// the worker lists what it has when it connects.
  void reconnect();
  /// Closes both streams after their queued messages and opens no others.
  void finish();
  /// Returns whether no stream or call is open.
  bool closed() const { return work_ == nullptr && deliver_ == nullptr && keepalive_ == nullptr; }
  /// Cancels both streams.
  void cancel();
  /// Recent minimum time from offering a block to its acknowledgement, seconds. The minimum
  /// excludes queueing.
  double ack_latency_seconds() const { return ack_latency_seconds_; }
  /// Records the acknowledgement of a block that was offered at `offered`.
  void record_acknowledgement(Time offered, Time now);

 private:
  void connect(Time now);
  void open_deliver();
  void on_response(v1::WorkResponse response);
  void on_closed(const absl::Status& status);
  void refuse(const absl::Status& status);
  void deliver();
  std::optional<UnitQueue::Block> next_block();
  void add_parts(v1::DeliverRequest& request);
  void check_silence(Time now);
  void check_acknowledgements(Time now);
  void send_keepalive();

  ServerChannel& channel_;
  const Options options_;
  UnitQueue& queue_;
  EventLoop& event_loop_;
  const Callbacks callbacks_;
  contract::Backoff backoff_;

  std::string session_key_;         // empty: none issued
  std::string last_connect_error_;  // last logged
  std::unique_ptr<WorkStream> work_;
  std::unique_ptr<DeliverStream> deliver_;
  std::unique_ptr<KeepaliveProbe> keepalive_;
  bool welcomed_ = false, finishing_ = false;
  bool deliver_cancelled_ = false, is_first_request_ = false;
  std::chrono::nanoseconds interval_, timeout_;
  Time connect_at_{}, last_response_at_{}, heartbeat_at_{};
  std::optional<Time> replaced_at_;  // when a newer stream last replaced that of this process

  std::optional<UnitQueue::Block> sending_;  // block being split into parts
  std::size_t sent_bytes_ = 0;
  std::deque<UnitQueue::Block> to_send_;  // further blocks of options_.blocks_to_send
  double ack_latency_seconds_ = 0;
};

}  // namespace tessera::agent
