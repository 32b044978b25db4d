#pragma once

#include <map>
#include <string>

#include "server/schedule/workers/worker.h"

namespace tessera::server {

/// The decisions of operators about workers, present or not: their pools, and which of them are set
/// aside. Pure.
class Placement {
 public:
  using ByWorker = std::map<std::string, std::string>;

  /// Moves a worker to a pool; "": to the one that it names itself.
  void move(const std::string& worker_id, const std::string& pool);
  /// Returns the pool of a worker that names `own` itself.
  std::string pool_of(const std::string& worker_id, const std::string& own) const;
  /// Pools that workers were moved to.
  const ByWorker& moved() const { return moved_; }

  void set_aside(const std::string& worker_id, const std::string& reason);
  void bring_back(const std::string& worker_id) { aside_.erase(worker_id); }
  /// Reasons of the workers that are set aside.
  const ByWorker& aside() const { return aside_; }

  /// Determines where a worker that is not counted belongs: its pool, and so which jobs it may be
  /// leased; whether it is set aside.
  void place(Worker& worker) const;

 private:
  ByWorker moved_, aside_;
};

}  // namespace tessera::server
