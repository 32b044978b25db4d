#include "server/schedule/workers/worker_table.h"

#include <algorithm>

namespace tessera::server {

Worker& WorkerTable::add(const std::string& id) {
  WorkerKey& key = by_id_[id];
  if (key == 0) key = ++last_key_;
  Worker& worker = workers_[key];
  worker.key = key;
  worker.id = id;
  return worker;
}

Worker* WorkerTable::find(WorkerKey key) {
  const auto found = workers_.find(key);
  return found == workers_.end() ? nullptr : &found->second;
}

const Worker* WorkerTable::find(WorkerKey key) const {
  const auto found = workers_.find(key);
  return found == workers_.end() ? nullptr : &found->second;
}

Worker* WorkerTable::find(const std::string& id) {
  const auto found = by_id_.find(id);
  return found == by_id_.end() ? nullptr : find(found->second);
}

const Worker* WorkerTable::find(const std::string& id) const {
  const auto found = by_id_.find(id);
  return found == by_id_.end() ? nullptr : find(found->second);
}

void WorkerTable::for_each(const std::function<void(Worker&)>& visit) {
  for (auto& [key, worker] : workers_) visit(worker);
}

void WorkerTable::erase_if(const std::function<bool(Worker&)>& is_gone) {
  for (auto it = workers_.begin(); it != workers_.end();) {
    if (is_gone(it->second)) {
      by_id_.erase(it->second.id);
      it = workers_.erase(it);
    } else {
      ++it;
    }
  }
}

std::string WorkerTable::witness_of(const std::string& worker_id) const {
  const Worker* worker = find(worker_id);
  return worker == nullptr ? worker_id : worker->witness;
}

const std::set<WorkerKey>& WorkerTable::of_witness(const std::string& witness) const {
  const auto peers = by_witness_.find(witness);
  return peers == by_witness_.end() ? none_ : peers->second;
}

bool WorkerTable::remove_witness(const Worker& worker) {
  const auto peers = by_witness_.find(worker.witness);
  if (peers == by_witness_.end()) return false;
  peers->second.erase(worker.key);
  if (!peers->second.empty()) return false;
  by_witness_.erase(peers);
  return true;
}

bool WorkerTable::has_leased(const std::string& certificate,
                             const std::function<bool(JobKey)>& matches) const {
  if (certificate.empty()) return false;
  const std::set<WorkerKey>& keys = of_witness(witness_name("", certificate));
  return std::any_of(keys.begin(), keys.end(), [&](WorkerKey key) {
    const std::set<JobKey>& jobs = workers_.at(key).leased_jobs;
    return std::any_of(jobs.begin(), jobs.end(), matches);
  });
}

}  // namespace tessera::server
