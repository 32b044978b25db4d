#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "tests/unit/server/schedule/simulation/simulated_farm.h"

namespace tessera::server {

inline constexpr const char* kTags[] = {"", "a", "b"};
inline constexpr const char* kPools[] = {"", "p"};
inline constexpr char kLimit[] = "licence";

/// A unit at a worker.
struct SimulatedFarm::Task {
  UnitName name;
  Lease lease;
  std::optional<Time> ready = {};  // when its rendering ends; absent: it has not begun
  bool is_delivered = false;       // without an acknowledgement
  contract::Digest digest = {};
};

struct SimulatedFarm::Computer {
  std::string id, certificate;
  bool is_faulty = false, is_anchor = false;
  std::string pool;
  std::int32_t threads = 1, credits = 1;
  std::set<std::string> tags;
  WorkerKey key = 0;
  bool is_up = true, is_connected = false;
  std::vector<Task> tasks;
};

struct SimulatedFarm::StoredUnit {
  std::string worker_id;
  contract::Digest digest;
  bool has_audit = false;  // that has not ended
};

struct SimulatedFarm::Stored {
  std::shared_ptr<const JobSpec> spec;
  JobState state = JobState::queued;
  std::map<contract::Unit, StoredUnit> units;  // committed, acknowledged
  std::set<std::int32_t> frames;               // finished
};

struct SimulatedFarm::Write {
  std::string worker_id;
  UnitName name;
  Lease lease;
  contract::Digest digest;
  bool has_audit = false;
  Time durable;
};

}  // namespace tessera::server
