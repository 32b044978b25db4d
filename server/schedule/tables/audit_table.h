#pragma once

#include <set>

#include "server/schedule/plan/job.h"
#include "server/schedule/queue/audit_queue.h"
#include "server/schedule/queue/ready_jobs.h"

namespace tessera::server {

/// Open audits: each job keeps its own, those without a holder wait here for a worker. Pure.
class AuditTable {
 public:
  /// `ready` must outlive this object.
  explicit AuditTable(ReadyJobs& ready) : ready_(ready) {}

  /// Lets an audit without a holder wait for a worker, unless its job is paused or has ended.
  void await_worker(const Job& job, const contract::Unit& unit, Audit& audit);
  void stop_waiting(const Job& job, const contract::Unit& unit, Audit& audit);
  const AuditQueue& waiting() const { return waiting_; }

  /// To be called when a job gets its first audit or may have lost the last one.
  void note_audits(const Job& job);
  /// Jobs with open audits.
  const std::set<JobKey>& audited_jobs() const { return audited_jobs_; }

 private:
  ReadyJobs& ready_;
  AuditQueue waiting_;
  std::set<JobKey> audited_jobs_;
};

}  // namespace tessera::server
