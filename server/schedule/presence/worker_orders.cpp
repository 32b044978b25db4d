#include "server/schedule/presence/worker_orders.h"

namespace tessera::server {

bool WorkerOrders::drain(const std::string& worker_id) {
  Worker* worker = workers_.find(worker_id);
  if (worker == nullptr || !worker->connected) return false;
  worker->outbox.drain = true;
  outgoing_.wake(*worker);
  connections_.begin_draining(worker->key);
  return true;
}

void WorkerOrders::move(const std::string& worker_id, const std::string& pool, Time now) {
  ready_.advance(now);
  placement_.move(worker_id, pool);
  if (Worker* worker = workers_.find(worker_id)) place_again(*worker, now);
}

void WorkerOrders::set_aside(const std::string& worker_id, const std::string& reason, Time now) {
  ready_.advance(now);
  placement_.set_aside(worker_id, reason);
  if (Worker* worker = workers_.find(worker_id)) place_again(*worker, now);
}

void WorkerOrders::bring_back(const std::string& worker_id, Time now) {
  ready_.advance(now);
  placement_.bring_back(worker_id);
  if (Worker* worker = workers_.find(worker_id)) place_again(*worker, now);
}

/// Call after placement_ has changed.
void WorkerOrders::place_again(Worker& worker, Time now) {
  counts_.uncount(worker);
  placement_.place(worker);
  counts_.recount(worker);
  for (const auto& [key, unit] : worker.leased_units) {
    const Job& job = jobs_.at(key);
    if (worker.set_aside || worker.serves.count(job.requirement) == 0)
      outgoing_.revoke(worker, job, unit);
  }
  ready_.note_work();
  dispatcher_.dispatch_all(now);
}

bool WorkerOrders::allow(const std::string& worker_id, Time now) {
  ready_.advance(now);
  const bool is_known = quarantine_.allow(worker_id);
  if (workers_.has_witness(workers_.witness_of(worker_id))) dispatcher_.dispatch_all(now);
  return is_known;
}

}  // namespace tessera::server
