#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "contract/digest.h"
#include "contract/render_settings.h"
#include "contract/version.h"

namespace tessera::server {

using Time = std::chrono::steady_clock::time_point;
using Duration = std::chrono::steady_clock::duration;

/// Seconds in a span.
inline double seconds(Duration span) {
  return std::chrono::duration<double>(span).count();
}

/// A job's place in the order of submission; never reused.
using JobKey = std::int64_t;

/// Names the files of a scene, all of them: jobs with the same ones have the same key.
using SceneKey = contract::Digest;

/// Where a job stands; the numbers are those of v1.Job.State and of the journal.
enum class JobState : std::int32_t {
  queued = 1,
  running = 2,
  paused = 3,
  done = 4,
  failed = 5,
  cancelled = 6
};

/// Whether nothing more happens to the job by itself.
inline bool has_ended(JobState state) {
  return state == JobState::done || state == JobState::failed || state == JobState::cancelled;
}

/// The state's name in capitals, as reports and logs have it.
const char* state_name(JobState state);

/// A file the scene names, and the asset behind it.
struct ManifestEntry {
  std::string uri;
  contract::Digest digest;
  std::int64_t size_bytes = 0;
};

/// What a client asked for. Plain data, fixed once the job is made (but for `extend`).
struct JobSpec {
  std::string id;
  std::string request_id;
  std::string name;
  std::string owner;
  std::int32_t priority = 0;     // higher first
  std::int32_t max_workers = 0;  // 0: no limit
  std::string required_tag;      // empty: every worker
  contract::RenderSettings settings;
  std::string scene_uri;
  std::vector<ManifestEntry> assets;
  std::vector<contract::Digest> references;  // of each frame, in their order; empty: none
  std::vector<std::string> scene_warnings;   // the client's, for the report
  std::string request;                       // as it came over the wire; opaque here
  /// What its blocks were rendered by; all of a job's are of one contract.
  std::int32_t render_contract = contract::kRenderContract;

  /// What the store must keep for the job: the manifest's assets and the references.
  std::vector<contract::Digest> asset_digests() const;
};

/// The scene a job renders: SHA-256 over the sorted digests of its files, whatever their names.
SceneKey scene_of(const JobSpec& spec);

}  // namespace tessera::server
