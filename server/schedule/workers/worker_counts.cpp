#include "server/schedule/workers/worker_counts.h"

namespace tessera::server {

/// Includes the worker in the counts that its state allows.
void WorkerCounts::count(Worker& worker) {
  const bool is_present = worker.is_available();
  if (is_present && !worker.is_present) present_.add(worker);
  worker.is_present = is_present;
  if (worker.is_working() && !worker.is_counted) working_.add(worker);
  worker.is_counted = worker.is_working();
  update_idle(worker);
}

void WorkerCounts::uncount(Worker& worker) {
  if (worker.is_present) present_.remove(worker);
  if (worker.is_counted) working_.remove(worker);
  worker.is_present = worker.is_counted = false;
  update_idle(worker);
}

void WorkerCounts::recount(Worker& worker) {
  note_step();
  const bool is_present = worker.is_available();
  if (worker.is_present != is_present || worker.is_counted != worker.is_working()) uncount(worker);
  count(worker);
}

void WorkerCounts::count_idle_tags(const Worker& worker, std::int32_t change) {
  const auto add = [&](const std::string& tag) {
    std::int32_t& workers = idle_tags_[tag];
    workers += change;
    if (workers == 0) idle_tags_.erase(tag);
  };
  add("");
  for (const std::string& served : worker.serves) add(served);
}

void WorkerCounts::update_idle(Worker& worker) {
  const bool is_idle = worker.is_counted && worker.credits > 0;
  if (is_idle && worker.idle_load == worker.load()) return;
  if (worker.idle_load) idle_.erase({*worker.idle_load, worker.key});
  if (worker.idle_load && !is_idle) count_idle_tags(worker, -1);
  if (is_idle && !worker.idle_load) count_idle_tags(worker, 1);
  worker.idle_load.reset();
  if (!is_idle) return;
  worker.idle_load = worker.load();
  idle_.emplace(*worker.idle_load, worker.key);
}

}  // namespace tessera::server
