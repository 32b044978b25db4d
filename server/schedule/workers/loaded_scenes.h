#pragma once

#include <map>
#include <set>

#include "server/schedule/workers/worker.h"

namespace tessera::server {

/// Workers by the scenes that they have loaded. Pure.
class LoadedScenes {
 public:
  /// Notes that the worker has loaded the scene; forgets its oldest one if it has too many.
  void remember(Worker& worker, const SceneKey& scene);
  /// Forgets all scenes of the worker.
  void forget(const Worker& worker);
  /// Forgets one: the worker lacks files of it.
  void forget(Worker& worker, const SceneKey& scene);
  const std::set<WorkerKey>& workers_with(const SceneKey& scene) const;

 private:
  void erase(const Worker& worker, const SceneKey& scene);

  std::map<SceneKey, std::set<WorkerKey>> workers_;
  std::set<WorkerKey> none_;  // what workers_with() returns for an unknown scene
};

}  // namespace tessera::server
