#include "server/schedule/tables/audit_table.h"

namespace tessera::server {

using contract::Unit;

void AuditTable::await_worker(const Job& job, const Unit& unit, Audit& audit) {
  if (job.state == JobState::paused || has_ended(job.state)) return;
  waiting_.insert(job.requirement, {job.key, unit}, audit);
  ready_.note_work();
}

void AuditTable::stop_waiting(const Job& job, const Unit& unit, Audit& audit) {
  waiting_.erase(job.requirement, {job.key, unit}, audit);
}

void AuditTable::note_audits(const Job& job) {
  if (job.audits.empty()) {
    audited_jobs_.erase(job.key);
  } else {
    audited_jobs_.insert(job.key);
  }
}

}  // namespace tessera::server
