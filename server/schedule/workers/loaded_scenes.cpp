#include "server/schedule/workers/loaded_scenes.h"

namespace tessera::server {

void LoadedScenes::remember(Worker& worker, const SceneKey& scene) {
  constexpr std::size_t kMaxScenes = 16;  // remembered per worker
  std::erase(worker.scenes, scene);
  worker.scenes.insert(worker.scenes.begin(), scene);
  workers_[scene].insert(worker.key);
  if (worker.scenes.size() <= kMaxScenes) return;
  erase(worker, worker.scenes.back());
  worker.scenes.pop_back();
}

void LoadedScenes::forget(const Worker& worker) {
  for (const SceneKey& scene : worker.scenes) erase(worker, scene);
}

void LoadedScenes::forget(Worker& worker, const SceneKey& scene) {
  std::erase(worker.scenes, scene);
  erase(worker, scene);
}

void LoadedScenes::erase(const Worker& worker, const SceneKey& scene) {
  const auto workers = workers_.find(scene);
  if (workers == workers_.end()) return;
  workers->second.erase(worker.key);
  if (workers->second.empty()) workers_.erase(workers);
}

const std::set<WorkerKey>& LoadedScenes::workers_with(const SceneKey& scene) const {
  const auto workers = workers_.find(scene);
  return workers == workers_.end() ? none_ : workers->second;
}

}  // namespace tessera::server
