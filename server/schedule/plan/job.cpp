#include "server/schedule/plan/job.h"

#include <algorithm>

#include "contract/tile_grid.h"

namespace tessera::server {

const char* state_name(JobState state) {
  switch (state) {
    case JobState::queued:
      return "QUEUED";
    case JobState::running:
      return "RUNNING";
    case JobState::paused:
      return "PAUSED";
    case JobState::done:
      return "DONE";
    case JobState::failed:
      return "FAILED";
    case JobState::cancelled:
      return "CANCELLED";
  }
  return "UNKNOWN";
}

SceneKey scene_key(const JobSpec& spec) {
  std::vector<contract::Digest> files;
  files.reserve(spec.assets.size());
  for (const ManifestEntry& entry : spec.assets) files.push_back(entry.digest);
  std::sort(files.begin(), files.end());
  contract::Hasher hasher;
  for (const contract::Digest& file : files) hasher.update(file.binary());
  return hasher.finish();
}

std::vector<contract::Digest> JobSpec::asset_digests() const {
  std::vector<contract::Digest> digests = references;
  for (const ManifestEntry& entry : assets) digests.push_back(entry.digest);
  return digests;
}

std::set<std::string> witnesses_of(const std::vector<Failure>& failures) {
  std::set<std::string> witnesses;
  for (const Failure& failure : failures) witnesses.insert(failure.witness);
  return witnesses;
}

std::set<std::string> UnitFailures::witnesses() const {
  constexpr std::int32_t kManyLosses = 3;  // by one witness
  std::set<std::string> names = witnesses_of(failures);
  for (const auto& [witness, count] : losses_by_witness) {
    if (count >= kManyLosses) names.insert(witness);
  }
  return names;
}

void UnitTimes::add(double cpu_seconds, std::int32_t sample_count) {
  const double value = cpu_seconds / std::max(sample_count, 1);
  if (per_sample_.size() < kWindow) {
    per_sample_.push_back(value);
  } else {
    per_sample_[next_++ % kWindow] = value;
  }
}

std::optional<double> UnitTimes::median(std::int32_t sample_count) const {
  if (per_sample_.empty()) return std::nullopt;
  std::vector<double> sorted = per_sample_;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle * sample_count;
}

JobPlan& Job::open_plan() {
  if (!plan) {
    const contract::RenderSettings& settings = spec->settings;
    plan.emplace(contract::frame_list(settings.frames), contract::tile_count(settings),
                 contract::schedule(settings), settings.error.has_value());
    for (const std::int32_t frame : blocked_frames) plan->hold_back(frame, true);
  }
  return *plan;
}

void Job::block_frame(std::int32_t frame, bool is_frame_blocked) {
  if (is_frame_blocked) {
    blocked_frames.insert(frame);
  } else {
    blocked_frames.erase(frame);
  }
  if (plan) plan->hold_back(frame, is_frame_blocked);
}

}  // namespace tessera::server
