#include "server/schedule/tables/job_table.h"

namespace tessera::server {

Job& JobTable::add(JobKey key, const std::string& id) {
  by_id_[id] = key;
  Job& job = jobs_[key];
  job.key = key;
  by_state_[index(job.state)].insert(key);
  return job;
}

void JobTable::erase(JobKey key) {
  const Job& job = jobs_.at(key);
  by_id_.erase(job.spec->id);
  by_state_[index(job.state)].erase(key);
  jobs_.erase(key);
}

Job* JobTable::find(JobKey key) {
  const auto found = jobs_.find(key);
  return found == jobs_.end() ? nullptr : &found->second;
}

const Job* JobTable::find(JobKey key) const {
  const auto found = jobs_.find(key);
  return found == jobs_.end() ? nullptr : &found->second;
}

Job* JobTable::find(const std::string& id) {
  const auto found = by_id_.find(id);
  return found == by_id_.end() ? nullptr : find(found->second);
}

const Job* JobTable::find(const std::string& id) const {
  const auto found = by_id_.find(id);
  return found == by_id_.end() ? nullptr : find(found->second);
}

void JobTable::for_each(const std::function<void(Job&)>& visit) {
  for (auto& [key, job] : jobs_) visit(job);
}

void JobTable::set_state(Job& job, JobState state) {
  if (job.state == state) return;
  by_state_[index(job.state)].erase(job.key);
  by_state_[index(state)].insert(job.key);
  job.state = state;
}

void JobTable::count_demand(const Job& job, int sign) {
  Demand& sum = demands_[job.spec->owner];
  sum.jobs += sign * job.demand.jobs;
  sum.store_bytes += sign * job.demand.store_bytes;
  sum.samples += sign * job.demand.samples;
  if (sum.jobs == 0) demands_.erase(job.spec->owner);  // and with it what rounding has left
}

Demand JobTable::demand(const std::string& owner) const {
  const auto found = demands_.find(owner);
  return found == demands_.end() ? Demand{} : found->second;
}

}  // namespace tessera::server
