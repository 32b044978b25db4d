#include "server/schedule/workers/placement.h"

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

void Placement::move(const std::string& worker_id, const std::string& pool) {
  if (pool.empty()) {
    moved_.erase(worker_id);
  } else {
    moved_[worker_id] = pool;
  }
}

std::string Placement::pool_of(const std::string& worker_id, const std::string& own) const {
  const auto moved = moved_.find(worker_id);
  const std::string& pool = moved != moved_.end() ? moved->second : own;
  return pool.empty() ? kDefaultPool : pool;
}

void Placement::set_aside(const std::string& worker_id, const std::string& reason) {
  aside_[worker_id] = reason;
}

void Placement::place(Worker& worker) const {
  worker.pool = pool_of(worker.id, worker.own_pool);
  worker.serves = {requirement(worker.pool, "")};
  for (const std::string& tag : worker.tags) worker.serves.insert(requirement(worker.pool, tag));
  const auto aside = aside_.find(worker.id);
  worker.set_aside = aside != aside_.end();
  worker.note = worker.set_aside ? aside->second : "";
}

}  // namespace tessera::server
