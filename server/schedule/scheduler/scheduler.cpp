#include "server/schedule/scheduler/scheduler.h"

#include <utility>

#include "server/schedule/scheduler/schedule_check.h"

namespace tessera::server {

Scheduler::Scheduler(StoreIdentity identity, SchedulePolicy policy,
                     const std::vector<std::string>& roster, Time start)
    : tables_(std::move(identity), std::move(policy), roster, start),
      witnesses_(tables_),
      quarantine_(tables_),
      dependencies_(tables_),
      states_(tables_, dependencies_),
      grants_(tables_, states_),
      choice_(tables_, witnesses_),
      dispatcher_(tables_, witnesses_, grants_, choice_),
      tail_balance_(tables_, grants_, choice_),
      lifecycle_(tables_, quarantine_, dependencies_, states_, dispatcher_),
      changes_(tables_, dependencies_, dispatcher_),
      limits_(tables_, dispatcher_),
      waiting_(tables_, witnesses_, dependencies_),
      results_(tables_, quarantine_, dependencies_, grants_, dispatcher_, lifecycle_),
      failures_(tables_, witnesses_, quarantine_, states_, dispatcher_, lifecycle_, results_),
      audits_(tables_, witnesses_, quarantine_, dispatcher_, lifecycle_),
      connections_(tables_, quarantine_, states_, dispatcher_, results_, failures_),
      liveness_(tables_, quarantine_, failures_),
      orders_(tables_, quarantine_, dispatcher_, connections_) {}

void Scheduler::tick(Time now, Duration period) {
  tables_.ready.advance(now);
  const Duration late = tables_.absences.note_tick(now, period);
  if (late > tables_.policy.timer_slack) {  // this process was suspended
    liveness_.extend(late);
    return;
  }
  liveness_.expire(now);
  quarantine_.end_timed_quarantines(now);
  liveness_.end_grace(now);
  audits_.fail_unresolvable_audits(now);
  tables_.ready.note_work();
  dispatcher_.dispatch_all(now);
  tail_balance_.balance_tail(now);
}

Effects Scheduler::take_effects() {
  tables_.ready.queue().sort();
  return tables_.outgoing.take();
}

absl::Status Scheduler::verify() const {
  return ScheduleCheck(tables_, quarantine_, dependencies_).verify();
}

}  // namespace tessera::server
