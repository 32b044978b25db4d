#include "server/schedule/presence/connections.h"

#include <algorithm>
#include <utility>

namespace tessera::server {

using contract::Unit;

namespace {

constexpr std::size_t kMaxListed = 4096;  // leases, and units, adopted from one hello

}  // namespace

WorkerKey Connections::connect(const Hello& hello, Time now) {
  ready_.advance(now);
  Worker& worker = workers_.add(hello.worker_id);
  counts_.uncount(worker);
  worker.name = hello.name;
  worker.host = hello.host;
  worker.isa = hello.isa;
  worker.certificate = hello.certificate;
  quarantine_.set_witness(worker, witness_name(hello.worker_id, hello.certificate));
  worker.thread_count = std::max(hello.thread_count, 1);
  worker.tags = {hello.tags.begin(), hello.tags.end()};
  worker.own_pool = hello.pool;
  placement_.place(worker);
  worker.connected = true;
  worker.lost = worker.draining = worker.left = false;
  worker.last_contact = now;
  worker.credits = std::max(hello.credit_count, 0);
  worker.outbox = {};
  outgoing_.effects().roster.emplace_back(worker.id, true);
  const bool ends_grace = absences_.arrive(worker.id);
  counts_.recount(worker);
  const bool had_work = ready_.has_new_work();
  ready_.set_new_work(false);
  adopt(worker, hello, now);
  if (ends_grace || had_work || ready_.has_new_work()) {
    ready_.note_work();
    dispatcher_.dispatch_all(now);
  } else {
    dispatcher_.dispatch(worker, now);  // others have had the chance to take what is waiting
  }
  return worker.key;
}

void Connections::record_contact(WorkerKey key, Time now) {
  if (Worker* worker = workers_.find(key)) worker->last_contact = now;
}

void Connections::heartbeat(WorkerKey key, const std::vector<UnitName>& started,
                            std::int64_t rss_bytes, Time now) {
  Worker* worker = workers_.find(key);
  if (worker == nullptr) return;
  worker->rss_bytes = rss_bytes;
  for (const UnitName& name : started) {
    Job* job = jobs_.find(name.job_id);
    InFlight* in_flight =
        job != nullptr && job->plan ? job->plan->find_in_flight(name.unit) : nullptr;
    if (in_flight == nullptr) continue;
    for (Holder& holder : in_flight->holders) {
      if (holder.worker == key && !holder.started) holder.started = now;
    }
  }
}

void Connections::grant_credits(WorkerKey key, std::int32_t count, Time now) {
  constexpr std::int32_t kMaxCredits = 1 << 20;  // limits what a faulty worker can claim
  Worker* worker = workers_.find(key);
  if (worker == nullptr || count <= 0) return;
  worker->credits = std::min(worker->credits, kMaxCredits) + std::min(count, kMaxCredits);
  ready_.advance(now);
  counts_.update_idle(*worker);
  if (worker->is_working()) dispatcher_.dispatch(*worker, now);
}

bool Connections::begin_draining(WorkerKey key) {
  Worker* worker = workers_.find(key);
  if (worker == nullptr || worker->draining) return false;
  worker->draining = true;
  counts_.recount(*worker);
  return true;
}

void Connections::return_units(WorkerKey key, const std::vector<UnitName>& units, Time now,
                               bool lacks_files) {
  Worker* worker = workers_.find(key);
  if (worker == nullptr) return;
  ready_.advance(now);
  for (const UnitName& name : units) {
    Job* job = jobs_.find(name.job_id);
    if (job == nullptr) continue;
    if (lacks_files) scenes_.forget(*worker, job->scene);
    if (job->plan) leases_.release(*job, *worker, name.unit);
  }
  dispatcher_.dispatch_all(now);
}

void Connections::scene_loaded(WorkerKey key, const std::string& job_id, const SceneLoad& load) {
  Worker* worker = workers_.find(key);
  Job* job = jobs_.find(job_id);
  if (worker == nullptr || job == nullptr) return;
  if (worker->leased_jobs.count(job->key) == 0) return;
  if (worker->current_job == job->key)
    worker->load_seconds = load.load_seconds + load.build_seconds;
  scenes_.remember(*worker, job->scene);
  JobCounters& counters = job->counters;
  counters.load_seconds += load.load_seconds;
  counters.build_seconds += load.build_seconds;
  counters.peak_rss_bytes = std::max(counters.peak_rss_bytes, load.peak_rss_bytes);
  ++counters.accelerator_builds;
  counters.accelerator_build_seconds += load.accelerator_build_seconds;
  counters.accelerator_bytes = std::max(counters.accelerator_bytes, load.accelerator_bytes);
}

void Connections::acknowledge(WorkerKey key, Acknowledgement acknowledgement) {
  Worker* worker = workers_.find(key);
  if (worker == nullptr || !worker->connected)
    return;  // without acknowledgement the worker sends again
  worker->outbox.acknowledgements.push_back(std::move(acknowledgement));
  outgoing_.wake(*worker);
}

void Connections::adopt(Worker& worker, const Hello& hello, Time now) {
  std::vector<const Lease*>
      leases;  // with valid seals; limited, as a long list would block the lock
  for (const Lease& lease : hello.leases) {
    if (leases.size() == kMaxListed) break;
    if (is_seal_valid(lease, worker.id, identity_.store_key)) leases.push_back(&lease);
  }
  std::map<std::pair<JobKey, Unit>, Attempt> listed;
  const auto list = [&](const UnitName& name) {
    if (listed.size() == kMaxListed) return;  // further results count when they arrive
    const auto found = std::find_if(leases.begin(), leases.end(), [&](const Lease* candidate) {
      return candidate->covers(name.unit) && candidate->job_id == name.job_id;
    });
    Job* job = jobs_.find(name.job_id);
    if (found == leases.end() || job == nullptr || has_ended(job->state)) return;
    const Lease* lease = *found;
    job->open_plan();
    if (!results_.wants(*job, *lease, name.unit) || job->plan->is_committed(name.unit)) return;
    listed.emplace(std::pair(job->key, name.unit), lease->attempt);
  };
  if (hello.store_id == identity_.store_id) {
    for (const UnitName& name : hello.running) list(name);
    for (const UnitName& name : hello.unacknowledged) list(name);
  }
  release_unlisted(worker, listed, now);
  const bool has_returned = ready_.has_new_work();
  for (const auto& [key, attempt] : listed) {
    Job& job = jobs_.at(key.first);
    if (worker.leased_units.count(key) > 0 || has_ended(job.state)) continue;
    leases_.hold(job, worker, key.second, Holder{worker.key, attempt, now, false, 0});
    if (job.state == JobState::queued) states_.set_state(job, JobState::running, "", now);
    ready_.refresh(job);
  }
  ready_.set_new_work(has_returned);  // a unit that is held is no work for others
}

void Connections::release_unlisted(Worker& worker,
                                   const std::map<std::pair<JobKey, Unit>, Attempt>& listed,
                                   Time now) {
  const auto before = worker.leased_units;
  for (const auto& key : before) {
    if (listed.count(key) > 0) continue;
    Job& job = jobs_.at(key.first);
    const InFlight* in_flight = job.plan->find_in_flight(key.second);
    if (in_flight == nullptr) {  // an audit: another worker has it now, but a result still counts
      leases_.release(job, worker, key.second);
      continue;
    }
    const auto& holders = in_flight->holders;
    const bool started = std::any_of(holders.begin(), holders.end(), [&](const Holder& holder) {
      return holder.worker == worker.key && holder.started;
    });
    if (started) {
      failures_.lose_unit(job, worker, key.second, now);
    } else {
      leases_.release(job, worker, key.second);
    }
  }
}

void Connections::disconnect(WorkerKey key) {
  if (Worker* worker = workers_.find(key)) outgoing_.disconnect(*worker);
}

}  // namespace tessera::server
