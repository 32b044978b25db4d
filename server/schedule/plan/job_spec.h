#pragma once

#include <chrono>
#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "contract/digest.h"
#include "contract/render_settings.h"
#include "contract/version.h"

namespace tessera::server {

using Time = std::chrono::steady_clock::time_point;
using Duration = std::chrono::steady_clock::duration;

/// Returns a duration in seconds.
inline double seconds(Duration span) {
  return std::chrono::duration<double>(span).count();
}

/// A job's number in the order of submission; never reused.
using JobKey = std::int64_t;

/// Identifies the set of a scene's files: jobs with equal files have equal keys.
using SceneKey = contract::Digest;

/// A job's state; numbers as in v1.Job.State and the journal.
enum class JobState : std::int32_t {
  queued = 1,
  running = 2,
  paused = 3,
  done = 4,
  failed = 5,
  cancelled = 6
};
inline constexpr std::size_t kJobStates = 6;

/// Returns whether the job can only change by a request.
inline bool has_ended(JobState state) {
  return state == JobState::done || state == JobState::failed || state == JobState::cancelled;
}

/// Returns the state's name in capitals, as in reports and logs.
const char* state_name(JobState state);

/// A file that the scene refers to, and its asset.
struct ManifestEntry {
  std::string uri;
  contract::Digest digest;
  std::int64_t size_bytes = 0;
};

/// A job that must make progress before another one is leased.
struct Dependency {
  enum class Kind : std::int32_t {  // numbers as in v1.JobDependency.Kind
    success = 1,                    // until it is DONE
    end = 2,                        // until it has ended, or is removed
    frames = 3                      // each frame, until the frame of the same number is finished
  };
  std::string job_id;
  Kind kind = Kind::success;
};

/// Units of a named limit that each unit of work takes while it is leased.
struct LimitUse {
  std::string limit;
  std::int32_t units = 1;
  auto operator<=>(const LimitUse&) const = default;
};

/// Kind of an account; numbers as in v1.Budget.Scope.
enum class AccountScope : std::int32_t { owner = 1, project = 2 };

/// The jobs of an owner, or those of a project.
struct Account {
  AccountScope scope = AccountScope::owner;
  std::string name;
  auto operator<=>(const Account&) const = default;
};

/// Pool of workers and jobs that name no pool.
inline constexpr char kDefaultPool[] = "default";

/// Returns the name under which workers of a pool with a tag are counted, and jobs that require
/// both wait; an empty tag stands for any worker of the pool. Pools and tags have no newline.
inline std::string requirement(const std::string& pool, const std::string& tag) {
  return (pool.empty() ? kDefaultPool : pool) + "\n" + tag;
}

/// A job as submitted. Plain data, constant after creation except for `extend`.
struct JobSpec {
  std::string id;
  std::string request_id;
  std::string name;
  std::string owner;
  std::int32_t priority = 0;              // higher first
  std::int32_t max_workers = 0;           // 0: unlimited
  std::string required_tag;               // empty: none
  std::string pool;                       // whose workers render it; empty: kDefaultPool
  std::vector<LimitUse> limits;           // sorted, each limit once
  std::string project;                    // whose account its use is charged to; empty: none
  std::set<std::string> blocked_workers;  // IDs of workers that are leased nothing of it
  std::vector<Dependency> after;
  contract::RenderSettings settings;
  std::string scene_uri;
  std::vector<ManifestEntry> assets;
  std::vector<contract::Digest> references;  // one per frame, in order; empty: none
  std::vector<std::string> scene_warnings;   // from the client, for the report
  std::string request;                       // the serialised request; opaque here
  /// Contract of its blocks; all blocks of a job have the same one.
  std::int32_t render_contract = contract::kRenderContract;
  /// The store's row or files of the job cannot be read. It is listed as failed and can only be
  /// removed; its row is left as it is, for a repaired store or another version of the server.
  bool is_unreadable = false;

  /// Returns what a worker must serve to render the job; see requirement().
  std::string requirement() const { return server::requirement(pool, required_tag); }
  /// Returns the assets that the store must keep for the job: manifest and references.
  std::vector<contract::Digest> asset_digests() const;
};

/// Returns the key of a job's scene: SHA-256 over the sorted digests of its files, whatever their
/// names.
SceneKey scene_key(const JobSpec& spec);

}  // namespace tessera::server
