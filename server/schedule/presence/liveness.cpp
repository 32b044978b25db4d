#include "server/schedule/presence/liveness.h"

namespace tessera::server {

void Liveness::mark_lost(Worker& worker, Time now) {
  worker.lost = true;
  counts_.recount(worker);
  outgoing_.effects().to_close.push_back(worker.key);
  outgoing_.effects().roster.emplace_back(worker.id, false);
  const auto leased = worker.leased_units;
  for (const auto& [key, unit] : leased) {
    if (Job* job = jobs_.find(key)) failures_.lose_unit(*job, worker, unit, now);
  }
  worker.leased_units.clear();
}

void Liveness::expire(Time now) {
  workers_.erase_if([&](Worker& worker) {
    const Duration silence = now - worker.last_contact;
    if (!worker.lost && silence > policy_.worker_timeout) mark_lost(worker, now);
    if (!worker.lost || worker.connected || silence <= policy_.forget_after) return false;
    counts_.uncount(worker);
    quarantine_.forget(worker);
    scenes_.forget(worker);
    return true;
  });
}

void Liveness::extend(Duration late) {
  // Messages that arrived meanwhile are still unread.
  workers_.for_each([&](Worker& worker) { worker.last_contact += late; });
  absences_.extend(late);
}

void Liveness::end_grace(Time now) {
  for (const std::string& id : absences_.end(now))
    outgoing_.effects().roster.emplace_back(id, false);
}

}  // namespace tessera::server
