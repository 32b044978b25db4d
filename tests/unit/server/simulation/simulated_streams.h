#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>

#include "server/workers/worker_registry.h"
#include "tests/unit/server/simulation/simulated_network.h"
#include "tests/unit/server/simulation/simulated_server.h"

namespace tessera::server {

/// A Work stream.
class SimulatedServer::Link final : public WorkerConnection,
                                    public std::enable_shared_from_this<Link> {
 public:
  explicit Link(SimulatedServer& server)
      : server_(server), up(server.network_.open()), down(server.network_.open()) {}

  void wake() override {}  // the outbox is read in each step
  void close(const absl::Status& reason) override;

 private:
  SimulatedServer& server_;

 public:
  const SimulatedNetwork::Stream up, down;  // to the server, to the worker
  // The server's end.
  std::optional<Session> session;  // since the worker's first message has arrived
  bool is_ended = false;           // nothing is written any more
  // The worker's end.
  bool is_broken = false;  // the worker will notice soon
};

/// A Deliver stream.
struct SimulatedServer::Upload {
  explicit Upload(SimulatedNetwork::Stream number) : stream(number) {}
  const SimulatedNetwork::Stream stream;
  std::deque<std::function<void()>> unread;  // messages that have arrived
  bool is_waiting = false;                   // for room for blocks
  bool is_ended = false;                     // by the server
};

}  // namespace tessera::server
