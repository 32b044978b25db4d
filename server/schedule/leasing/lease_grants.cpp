#include "server/schedule/leasing/lease_grants.h"

namespace tessera::server {

using contract::Unit;

void LeaseGrants::lease(Job& job, Worker& worker, const Run& run, Time now) {
  const Lease lease = make_lease(job, worker, run);
  introduce(job, worker);
  for (std::int32_t i = 0; i < run.tile_count; ++i) {
    const Unit unit{run.frame, run.first_tile + i, run.pass};
    leases_.hold(job, worker, unit, Holder{worker.key, lease.attempt, std::nullopt, false, 0, now});
    if (job.unit_failures.count(unit) > 0) ++job.counters.retried;
  }
  if (worker.current_job != job.key) {
    worker.current_job = job.key;
    worker.seconds_in_job = 0;
    worker.load_seconds.reset();
  }
  if (job.state == JobState::queued) states_.set_state(job, JobState::running, "", now);
  if (!job.running_since) job.running_since = now;
  send_lease(worker, lease);
  ready_.refresh(job);
}

Lease LeaseGrants::make_lease(const Job& job, const Worker& worker, const Run& run) {
  const contract::Pass& pass = job.plan->shape().passes[static_cast<std::size_t>(run.pass)];
  Lease lease{job.spec->id,
              run.frame,
              run.pass,
              run.first_tile,
              run.tile_count,
              pass.first_sample,
              pass.sample_count,
              {identity_.boot, ++last_attempt_},
              {}};
  lease.seal = make_seal(lease, worker.id, identity_.store_key);
  return lease;
}

void LeaseGrants::introduce(const Job& job, Worker& worker) {
  if (job.ever_leased_to.count(worker.key) == 0) worker.outbox.new_jobs.push_back(job.spec);
}

void LeaseGrants::send_lease(Worker& worker, const Lease& lease) {
  worker.credits -= lease.tile_count;
  counts_.update_idle(worker);
  worker.outbox.leases.push_back(lease);
  outgoing_.wake(worker);
}

void LeaseGrants::lease_audit(Job& job, Unit unit, Worker& worker) {
  const Lease lease = make_lease(job, worker, {unit.frame, unit.pass, unit.tile, 1});
  introduce(job, worker);
  leases_.hold_audit(job, worker, unit, lease.attempt);
  send_lease(worker, lease);
}

}  // namespace tessera::server
