#pragma once

#include <string>

#include "server/schedule/leasing/dispatcher.h"
#include "server/schedule/presence/connections.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/quarantine.h"

namespace tessera::server {

/// Commands of operators about workers.
class WorkerOrders {
 public:
  WorkerOrders(Tables& tables, Quarantine& quarantine, Dispatcher& dispatcher,
               Connections& connections)
      : workers_(tables.workers),
        counts_(tables.counts),
        placement_(tables.placement),
        jobs_(tables.jobs),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        quarantine_(quarantine),
        dispatcher_(dispatcher),
        connections_(connections) {}

  /// Lifts the ban or quarantine of a worker and of its certificate. Returns whether the worker is
  /// known or had one.
  bool allow(const std::string& worker_id, Time now);
  /// The decisions of operators that move() and set_aside() recorded.
  const Placement& placement() const { return placement_; }
  /// Drains a worker. Returns whether it is connected.
  bool drain(const std::string& worker_id);
  /// Moves a worker, present or not, to a pool; "": to the one that it names itself. It returns
  /// units that it has not started.
  void move(const std::string& worker_id, const std::string& pool, Time now);
  /// Sets a worker aside, present or not: it finishes the units that it has started, returns the
  /// others and is leased nothing.
  void set_aside(const std::string& worker_id, const std::string& reason, Time now);
  void bring_back(const std::string& worker_id, Time now);

 private:
  void place_again(Worker& worker, Time now);

  WorkerTable& workers_;
  WorkerCounts& counts_;
  Placement& placement_;
  JobTable& jobs_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  Quarantine& quarantine_;
  Dispatcher& dispatcher_;
  Connections& connections_;
};

}  // namespace tessera::server
