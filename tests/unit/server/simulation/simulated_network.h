#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <utility>

#include "server/schedule/plan/job_spec.h"
#include "tests/support/dice.h"

namespace tessera::server {

/// Messages under way between processes, in simulated time. Messages of one direction of a stream
/// arrive in order. Messages of different streams, and calls without a stream, overtake each other,
/// because each has a random delay.
class SimulatedNetwork {
 public:
  /// One direction of a stream.
  using Stream = std::int64_t;
  /// Counts, so that a test can see that messages are lost and overtake each other.
  struct Events {
    int lost = 0, overtaken = 0;
  };

  /// `dice` must outlive the network.
  explicit SimulatedNetwork(testing::Dice& dice) : dice_(dice) {}

  Stream open();
  /// Sends a message on an open stream; on one that is broken it is lost.
  void send(Stream stream, Time now, std::function<void()> arrive);
  /// Sends a message of a call of its own, which no other message waits for.
  void send(Time now, std::function<void()> arrive);
  /// Breaks a stream. The messages that follow a random one are lost, the others still arrive, also
  /// after those of a stream that is opened later.
  void cut(Stream stream);
  /// Breaks all streams and loses all messages: a process at their end has died.
  void clear();
  /// Delivers what arrives up to this time, in order of arrival.
  void deliver(Time now);
  /// From now on messages take less than a step.
  void calm_down() { is_calm_ = true; }
  bool empty() const { return messages_.empty(); }
  const Events& events() const { return events_; }

 private:
  struct Message {
    Stream stream = 0;
    std::int64_t number = 0;  // in the order of sending
    std::function<void()> arrive;
  };
  Duration delay();

  testing::Dice& dice_;
  bool is_calm_ = false;
  Stream last_stream_ = 0;
  std::int64_t last_number_ = 0;
  std::int64_t newest_arrived_ = 0;
  std::map<Stream, Time> due_;             // when the last message of each open stream arrives
  std::multimap<Time, Message> messages_;  // by arrival; equal ones in the order of sending
  Events events_;
};

}  // namespace tessera::server
