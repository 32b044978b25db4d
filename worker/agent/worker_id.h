#pragma once

#include <string>

#include "worker/ipc/descriptor.h"

namespace tessera::agent {

/// ID of a worker that was given none, and the lock that keeps other processes from using it.
struct WorkerId {
  std::string id;
  Descriptor lock;  // hold it while the worker runs; none: the ID is for this process only
};

/// Returns the ID that an earlier worker of this host used with the same cache directory, so that
/// decisions about the worker, such as its pool, outlast its restart. Workers that run at the same
/// time have different IDs: each locks a file HOST-N.id, which is created with a random ID if
/// missing. Without access to such files the ID is random. Do not fork while holding the lock: a
/// child process keeps it.
WorkerId claim_worker_id(const std::string& cache_folder, const std::string& host);

}  // namespace tessera::agent
