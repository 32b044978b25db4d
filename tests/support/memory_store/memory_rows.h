#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "server/store/jobs/frame_store.h"
#include "server/store/jobs/job_store.h"
#include "server/store/jobs/unit_store.h"

namespace tessera::server {

/// Jobs of a store in memory, with their units and frames, and the failures that a test injects.
struct MemoryRows {
  mutable std::mutex mutex;  // protects the rest
  absl::Status commit_fault, transaction_fault;
  std::map<std::string, absl::Status> job_faults;  // by job
  std::int64_t last_sequence = 0;
  std::set<std::string> used_ids, released;
  std::map<std::int64_t, JobRecord> jobs;
  std::map<std::string, std::int32_t> removed;  // states
  std::map<std::string, std::map<contract::Unit, std::pair<UnitRecord, std::string>>> units;
  std::map<std::string, std::map<std::string, UnitTotals>> totals;  // by job, worker
  std::map<std::string, std::map<std::int32_t, FrameRecord>> frames;
};

}  // namespace tessera::server
