#pragma once

#include <grpcpp/channel.h>

#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>

#include "telemetry/log/log.h"
#include "worker/agent/units/event_loop.h"
#include "worker/agent/units/unit_queue.h"
#include "worker/agent/server/worker_streams.h"

namespace tessera::agent {

/// The worker's two streams to its server: opens them, says Hello, beats, delivers blocks, and
/// connects again with back-off and jitter when they break or fall silent (farm.md, section 2).
///
/// Lives on the agent's thread; gRPC's callbacks come through the mailbox.
class ServerConnection {
 public:
  struct Options {
    std::string token;           // sent until the server gives a session key instead
    bool deliver_twice = false;  // fault injection for tests: every block is sent a second time
    bool forge =
        false;  // fault injection: a false block under a lease nobody gave goes before each
    Log log = no_log;
  };
  struct Callbacks {
    std::function<v1::WorkerHello()> hello;             // all but what the queue describes
    std::function<CreditWindow()> window;               // units wanted
    std::function<std::int64_t()> rss_bytes;            // for heartbeats
    std::function<void(v1::WorkResponse)> on_response;  // but Welcome
    std::function<void(absl::Status)> refused;          // connecting again is useless
  };

  /// All references must outlive the link.
  ServerConnection(v1::WorkerService::Stub& stub, Options options, UnitQueue& queue, EventLoop& mailbox,
             Callbacks outlet);

  /// Connects, beats and delivers as is due. Call after every change and at next_due().
  void pump(Time now);
  Time next_due() const;
  /// Queues a message; dropped without a connection, as Hello says it all again.
  void send(v1::WorkRequest request);
  bool connected() const { return welcomed_; }
  /// Closes both streams in order. No others are opened.
  void finish();
  /// Whether nothing is open any more.
  bool closed() const { return work_ == nullptr && deliver_ == nullptr && life_sign_ == nullptr; }
  /// Breaks off both streams.
  void cancel();
  /// What a question takes to its answer, seconds: the least time of late from when a block was
  /// offered to its verdict, which did not wait behind others.
  double round_trip_seconds() const { return round_trip_seconds_; }
  /// A verdict came, on a block that was offered at `offered`.
  void note_verdict(Time offered, Time now);

 private:
  void connect(Time now);
  void open_deliver();
  void on_response(v1::WorkResponse response);
  void on_closed(const absl::Status& status);
  void deliver();
  std::optional<UnitQueue::Block> next_block();
  void add_parts(v1::DeliverRequest& request);
  void check_silence(Time now);
  void check_verdicts(Time now);
  void ask_for_life_sign();

  v1::WorkerService::Stub& stub_;
  const Options options_;
  UnitQueue& queue_;
  EventLoop& mailbox_;
  const Callbacks outlet_;
  std::mt19937 random_;  // jitter only

  std::string session_key_;  // empty: none was given
  std::string unreachable_;  // what was last said of a server that does not answer
  std::unique_ptr<WorkStream> work_;
  std::unique_ptr<DeliverStream> deliver_;
  std::unique_ptr<KeepaliveProbe> life_sign_;
  bool welcomed_ = false, finishing_ = false;
  bool deliver_cancelled_ = false, names_itself_ = false;
  std::chrono::nanoseconds interval_, timeout_;
  std::chrono::milliseconds pause_;
  Time connect_at_{}, heard_{}, beat_at_{};

  std::optional<UnitQueue::Block> sending_;  // block of which a part has been queued
  std::size_t sent_bytes_ = 0;
  bool sent_once_ = false;                        // of deliver_twice
  std::optional<UnitQueue::Block> after_forged_;  // of forge: the true block
  double round_trip_seconds_ = 0;
};

}  // namespace tessera::agent
