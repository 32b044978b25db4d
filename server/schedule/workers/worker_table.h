#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>

#include "server/schedule/workers/worker.h"

namespace tessera::server {

/// Workers that are connected or were recently, by key, by ID and by witness. Pure.
class WorkerTable {
 public:
  /// Returns the worker with this ID; adds it if there is none.
  Worker& add(const std::string& id);
  /// Null: there is no such worker.
  Worker* find(WorkerKey key);
  const Worker* find(WorkerKey key) const;
  Worker* find(const std::string& id);
  const Worker* find(const std::string& id) const;
  Worker& at(WorkerKey key) { return workers_.at(key); }
  const Worker& at(WorkerKey key) const { return workers_.at(key); }
  const std::map<WorkerKey, Worker>& all() const { return workers_; }
  void for_each(const std::function<void(Worker&)>& visit);
  /// Visits all workers, and removes those for which the result is true.
  void erase_if(const std::function<bool(Worker&)>& is_gone);

  /// Returns the witness of a worker; of an unknown one, its ID.
  std::string witness_of(const std::string& worker_id) const;
  /// Returns the workers of a witness.
  const std::set<WorkerKey>& of_witness(const std::string& witness) const;
  bool has_witness(const std::string& witness) const { return by_witness_.count(witness) > 0; }
  std::size_t witness_count() const { return by_witness_.size(); }
  /// Includes the worker among those of its witness.
  void add_witness(const Worker& worker) { by_witness_[worker.witness].insert(worker.key); }
  /// The reverse. Returns whether the witness has no other worker.
  bool remove_witness(const Worker& worker);
  /// Returns whether units of an unfinished job for which `matches` holds were leased to a worker
  /// with this certificate.
  bool has_leased(const std::string& certificate, const std::function<bool(JobKey)>& matches) const;

 private:
  std::map<WorkerKey, Worker> workers_;
  std::map<std::string, WorkerKey> by_id_;
  std::map<std::string, std::set<WorkerKey>> by_witness_;
  std::set<WorkerKey> none_;  // what of_witness() returns for an unknown witness
  WorkerKey last_key_ = 0;
};

}  // namespace tessera::server
