#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Workers whose results are refused, because they were banned or found faulty or, for a time,
/// because they failed units that others rendered. Counts by witness, so that one faulty worker
/// fails no job (docs/explanation/fault-tolerance.md).
class Quarantine {
 public:
  explicit Quarantine(Tables& tables)
      : workers_(tables.workers),
        counts_(tables.counts),
        jobs_(tables.jobs),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        leases_(tables.leases),
        audits_(tables.audits),
        policy_(tables.policy) {}

  /// How the workers of a witness behave.
  struct Conduct {
    std::set<JobKey> failing_jobs;  // of which they failed units; none was delivered since
    std::int32_t disproved = 0;     // units that they failed and another witness rendered
    bool quarantined = false;
    std::optional<Time> quarantined_until;  // empty: until allowed again
  };
  /// Names who answers for the worker. One that shares its witness with a worker that is
  /// quarantined is quarantined likewise.
  void set_witness(Worker& worker, std::string witness);
  /// Forgets a worker that is gone.
  void forget(const Worker& worker);
  /// Lifts the ban or quarantine of a worker and of its certificate. Returns whether the worker is
  /// known or had one.
  bool allow(const std::string& worker_id);
  /// Notes that a worker of the witness delivered a unit.
  void note_delivered(const std::string& witness);
  const std::map<std::string, Conduct>& conduct() const { return conduct_; }
  /// Returns whether the worker is quarantined for wrong pixels or banned; its further results are
  /// then obsolete.
  bool is_quarantined(const std::string& worker_id) const;
  /// Returns the names under which a worker is banned: its ID and, if it has a certificate, that of
  /// its witness. They are journaled, and given to ban() after a restart.
  std::vector<std::string> names_to_ban(const std::string& worker_id) const;
  /// IDs and witnesses that are banned or delivered wrong pixels.
  const std::set<std::string>& banned() const { return quarantined_; }
  /// Bans a worker, connected or not, and every worker with its certificate: releases their units
  /// to others; their further results are obsolete. Committed results stay. `name`: a worker ID, or
  /// a name of names_to_ban().
  void ban(const std::string& name);
  /// Counts a failure against the worker until it delivers a unit or the job ends. One that fails
  /// units of several jobs is quarantined for a time if there is another.
  void note_failing(Worker& worker, Job& job, Time now);
  /// The job has ended: its failures no longer count against workers. Failures that others
  /// disproved have been counted.
  void forgive(Job& job);
  /// Another witness rendered what these failed.
  void disprove(const std::set<std::string>& failed, const std::string& witness);
  /// A unit was delivered: what others reported about it counts against them.
  void disprove_failures(Job& job, const contract::Unit& unit, const std::string& witness);
  /// Ends quarantines whose time is over.
  void end_timed_quarantines(Time now);

 private:
  void forget_witness(const Worker& worker);
  void exclude(Worker& worker);
  void quarantine_witness(const std::string& witness, std::optional<Time> until);
  void end_quarantine(const std::string& witness);

  WorkerTable& workers_;
  WorkerCounts& counts_;
  JobTable& jobs_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  LeaseTable& leases_;
  const AuditTable& audits_;
  const SchedulePolicy& policy_;
  std::map<std::string, Conduct> conduct_;  // by witness
  std::set<std::string> quarantined_;       // IDs and witnesses: faulty or banned
  std::set<WorkerKey> timed_quarantines_;   // for a time
};

}  // namespace tessera::server
