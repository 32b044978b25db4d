#pragma once

#include <set>

#include "server/schedule/plan/job.h"
#include "server/schedule/tables/effects.h"
#include "server/schedule/workers/worker_counts.h"

namespace tessera::server {

/// Decisions that others carry out: messages to workers, and effects. Pure.
class Outgoing {
 public:
  /// `max_outbox`: messages that a worker may leave unread. `counts` must outlive this object.
  Outgoing(std::size_t max_outbox, WorkerCounts& counts)
      : max_outbox_(max_outbox), counts_(counts) {}

  Effects& effects() { return effects_; }
  /// Returns the actions decided since the last call.
  Effects take();

  /// Has the worker's messages sent. A worker that does not read them is disconnected: it lists
  /// what it has when it comes back.
  void wake(Worker& worker);
  /// Has the worker return the unit unless it has started it.
  void revoke(Worker& worker, const Job& job, const contract::Unit& unit);
  /// Has the worker return the units of the job that it has not started.
  void revoke_units(Worker& worker, const Job& job);
  /// Notes that the worker's stream broke; the worker is lost after the timeout.
  void disconnect(Worker& worker);

 private:
  std::size_t max_outbox_;
  WorkerCounts& counts_;
  std::set<WorkerKey> to_wake_;
  Effects effects_;
};

}  // namespace tessera::server
