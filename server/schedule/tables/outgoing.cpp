#include "server/schedule/tables/outgoing.h"

#include <utility>

namespace tessera::server {

using contract::Unit;

Effects Outgoing::take() {
  effects_.to_wake.assign(to_wake_.begin(), to_wake_.end());
  to_wake_.clear();
  return std::exchange(effects_, Effects{});
}

void Outgoing::wake(Worker& worker) {
  if (!worker.connected) {
    worker.outbox = {};  // when it connects it says what it holds, and is told what it needs then
    return;
  }
  if (worker.outbox.size() > max_outbox_) {
    worker.outbox = {};
    to_wake_.erase(worker.key);
    effects_.to_close_unread.push_back(worker.key);
    disconnect(worker);
    return;
  }
  to_wake_.insert(worker.key);
}

void Outgoing::revoke(Worker& worker, const Job& job, const Unit& unit) {
  Outbox& outbox = worker.outbox;
  (outbox.has_lease(job.spec->id, unit) ? outbox.withdrawn : outbox.revoked)
      .push_back({job.spec->id, unit});
  wake(worker);
}

void Outgoing::revoke_units(Worker& worker, const Job& job) {
  for (const auto& [key, unit] : worker.leased_units) {
    if (key == job.key) revoke(worker, job, unit);
  }
}

void Outgoing::disconnect(Worker& worker) {
  if (!worker.connected) return;
  worker.connected = false;
  counts_.recount(worker);
  if (!worker.draining || !worker.leased_units.empty()) return;
  worker.lost = worker.left = true;
  counts_.recount(worker);
  effects_.left.push_back(worker.key);
  effects_.roster.emplace_back(worker.id, false);
}

}  // namespace tessera::server
