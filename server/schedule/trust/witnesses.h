#pragma once

#include <set>
#include <string>

#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Returns whether the worker is known to have the files of the job's scene.
bool has_scene(const Worker& worker, const Job& job);
/// Returns whether the worker is leased nothing of the job: it is blocked for it, or it would have
/// to fetch a file that the store has lost.
bool is_barred(const Worker& worker, const Job& job);

/// Finds independent workers that could render a unit or decide an audit. Workers with one
/// certificate are one witness, so that no operator confirms its own results.
class Witnesses {
 public:
  explicit Witnesses(const Tables& tables)
      : workers_(tables.workers),
        counts_(tables.counts),
        absences_(tables.absences),
        ready_(tables.ready),
        policy_(tables.policy) {}

  /// Returns whether the worker could be leased units of the job, apart from its current load.
  bool could_audit(const Worker& worker, const Job& job) const;
  /// Returns whether a worker that is present, and not barred from the job, has another witness
  /// than these.
  bool has_witness_beyond(const Job& job, const std::set<std::string>& asked) const;
  /// Returns whether a witness that was not asked yet could be. In a dispute this includes one
  /// whose worker was lost recently: it may return, and a dispute between two consistent workers
  /// fails the job.
  bool has_others(const Job& job, const Audit& audit) const;
  /// Returns whether a witness beyond those asked can render the job, or may be back soon: after a
  /// restart, or after a loss of its connection. Otherwise one worker could fail a job while the
  /// others are away for a moment.
  bool has_others(const Job& job, const std::set<std::string>& asked) const;
  /// Returns whether the worker may be leased the audit.
  bool may_audit(const Worker& worker, const Job& job, const Audit& audit) const;
  /// Returns whether a worker that is present could answer the audit.
  bool has_candidate(const Job& job, const Audit& audit) const;
  /// Returns the witnesses on which the unit failed or its frame's scene was found at fault.
  std::set<std::string> failed_witnesses(const Job& job, const contract::Unit& unit) const;

 private:
  bool has_unblocked_witness(const Job& job, const std::string& witness) const;

  const WorkerTable& workers_;
  const WorkerCounts& counts_;
  const Absences& absences_;
  const ReadyJobs& ready_;
  const SchedulePolicy& policy_;
};

}  // namespace tessera::server
