#pragma once

#include <string>
#include <utility>
#include <vector>

#include "server/schedule/workers/worker.h"

namespace tessera::server {

/// Actions the coordinator must carry out.
struct Effects {
  std::vector<WorkerKey> to_wake;          // workers with messages in the outbox
  std::vector<WorkerKey> to_close;         // lost workers whose stream, if any, must be closed
  std::vector<WorkerKey> to_close_unread;  // workers that leave their messages unread
  std::vector<WorkerKey> left;             // drained workers that have disconnected
  std::vector<JobKey> changed;             // jobs whose state is new and must be journaled
  std::vector<JobKey> revised;             // jobs whose row must be journaled for another reason
  std::vector<std::pair<std::string, bool>> roster;  // worker ID; true: joined, false: gone
  std::vector<UnitName> audited;                     // units whose audit has ended
  std::vector<std::string> faulty_workers;  // workers whose committed units must be dropped
};

}  // namespace tessera::server
