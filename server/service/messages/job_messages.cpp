#include "server/service/messages/job_messages.h"

#include <algorithm>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/tile_grid.h"
#include "rpc/settings_message.h"
#include "server/service/messages/field_checks.h"

namespace tessera::server {
namespace {

constexpr std::size_t kMaxSceneNameLetters = 1000, kMaxUriLetters = 4096, kMaxWarningLetters = 4000,
                      kMaxWarnings = 101;
constexpr int kMaxAssets = 100'000, kMaxFrameRanges = 4096;
constexpr int kMaxDependencies = 64, kMaxLimitUses = 16, kMaxBlocked = 1000, kMaxFilterValues = 100;

/// Checks that a URI, by which workers read a resource, cannot lead out of a directory.
bool is_inside(const std::string& uri) {
  if (uri.empty() || uri.size() > kMaxUriLetters || uri.front() == '/') return false;
  if (uri.find('\0') != std::string::npos || uri.find('\\') != std::string::npos) return false;
  for (std::size_t begin = 0; begin <= uri.size();) {
    const std::size_t end = std::min(uri.find('/', begin), uri.size());
    if (uri.compare(begin, end - begin, "..") == 0) return false;
    begin = end + 1;
  }
  return true;
}

/// Reads references: R, G, B, A of every pixel as float32.
absl::Status read_references(const v1::CreateJobRequest& request, JobSpec& spec) {
  if (request.references().empty()) return absl::OkStatus();
  if (static_cast<std::size_t>(request.references_size()) !=
      contract::frame_list(spec.settings.frames).size()) {
    return bad("references", "expected one per frame, or none");
  }
  const std::int64_t size = 16 * std::int64_t{spec.settings.width} * spec.settings.height;
  for (const v1::AssetId& asset : request.references()) {
    const auto digest = contract::Digest::from_binary(asset.sha256());
    if (!digest) return bad("references.sha256", "expected 32 bytes");
    if (asset.size_bytes() != size) {
      return bad("references.size_bytes", absl::StrCat(asset.size_bytes(), " is not ", size,
                                                       ", 16 bytes per pixel of the frame"));
    }
    spec.references.push_back(*digest);
  }
  return absl::OkStatus();
}

absl::Status read_manifest(const v1::SceneManifest& message, JobSpec& spec) {
  if (message.assets_size() > kMaxAssets) return bad("manifest.assets", "more than 100000");
  spec.scene_uri = message.scene_uri();
  std::set<std::string> uris;
  for (const v1::ManifestEntry& entry : message.assets()) {
    const auto digest = contract::Digest::from_binary(entry.asset().sha256());
    if (!is_inside(entry.uri())) {
      return bad("manifest.assets.uri",
                 absl::StrCat("\"", entry.uri().substr(0, 200),
                              "\" is not a path inside the scene's directory"));
    }
    if (!digest) return bad("manifest.assets.asset.sha256", "expected 32 bytes");
    if (entry.asset().size_bytes() < 0)
      return bad("manifest.assets.asset.size_bytes", "is negative");
    if (!uris.insert(entry.uri()).second) {
      return bad("manifest.assets.uri", absl::StrCat("\"", entry.uri(), "\" is duplicated"));
    }
    spec.assets.push_back({entry.uri(), *digest, entry.asset().size_bytes()});
  }
  if (uris.count(spec.scene_uri) == 0) {
    return bad("manifest.scene_uri",
               absl::StrCat("\"", spec.scene_uri, "\" is not among the assets"));
  }
  const std::string& sky = spec.settings.environment;
  if (!sky.empty() && uris.count(sky) == 0) {
    return bad("settings.environment_uri", absl::StrCat("\"", sky, "\" is not among the assets"));
  }
  return absl::OkStatus();
}

/// Limits the number of tiles, because each costs memory.
absl::Status check_tiles(const contract::RenderSettings& settings) {
  constexpr std::int32_t kMaxTiles = 1 << 22;
  const std::int32_t tiles = contract::tile_count(settings);
  if (tiles <= kMaxTiles) return absl::OkStatus();
  return bad("settings.tile_px", absl::StrCat(settings.tile, " gives ", tiles,
                                              " tiles per frame, maximum ", kMaxTiles));
}

void set_progress(const JobView& view, v1::JobProgress& progress) {
  progress.set_unit_count(view.unit_count);
  progress.set_committed_unit_count(view.committed_unit_count);
  progress.set_leased_unit_count(view.leased_unit_count);
  progress.set_frame_count(view.frame_count);
  progress.set_finished_frame_count(view.finished_frame_count);
  progress.set_committed_sample_count(view.committed_sample_count);
  progress.set_sample_count(view.sample_count);
  progress.set_worker_count(view.worker_count);
  progress.set_cpu_seconds(view.cpu_seconds);
  if (view.estimated_error) progress.set_estimated_error(*view.estimated_error);
  set_duration(view.elapsed_seconds, *progress.mutable_elapsed());
  if (view.remaining_seconds) set_duration(*view.remaining_seconds, *progress.mutable_remaining());
}

absl::Status check_workers(const std::string& field,
                           const google::protobuf::RepeatedPtrField<std::string>& ids) {
  absl::Status status = check_range(field, ids.size(), 0, kMaxBlocked);
  for (const std::string& id : ids) status.Update(check_name(field, id));
  return status;
}

absl::Status read_filter(const std::string& field,
                         const google::protobuf::RepeatedPtrField<std::string>& values,
                         std::set<std::string>& wanted) {
  absl::Status status = check_range(field, values.size(), 0, kMaxFilterValues);
  for (const std::string& value : values) {
    status.Update(check_text(field, value, 0, kMaxNameLetters));
  }
  if (status.ok()) wanted = {values.begin(), values.end()};
  return status;
}

/// Checks what is shown or stored as it is.
absl::Status check_texts(const v1::CreateJobRequest& request) {
  absl::Status status = check_text("request_id", request.request_id(), 1, kMaxIdLetters);
  status.Update(check_text("name", request.name(), 1, kMaxNameLetters));
  status.Update(check_text("required_tag", request.required_tag(), 0, kMaxIdLetters));
  status.Update(check_range("scene_warnings", request.scene_warnings_size(), 0, kMaxWarnings));
  for (const std::string& text : request.scene_warnings()) {
    status.Update(check_text("scene_warnings", text, 1, kMaxWarningLetters));
  }
  const v1::RenderSettings& settings = request.settings();
  status.Update(check_text("settings.camera", settings.camera(), 0, kMaxSceneNameLetters));
  status.Update(check_text("settings.animation", settings.animation(), 0, kMaxSceneNameLetters));
  if (!request.pool().empty()) status.Update(check_name("pool", request.pool()));
  if (!request.project().empty()) status.Update(check_name("project", request.project()));
  status.Update(check_workers("blocked_worker_ids", request.blocked_worker_ids()));
  status.Update(check_text("settings.variant", settings.variant(), 0, kMaxSceneNameLetters));
  status.Update(check_range("settings.frames", settings.frames_size(), 0, kMaxFrameRanges));
  return status;
}

absl::StatusOr<std::vector<LimitUse>> read_limits(
    const google::protobuf::RepeatedPtrField<v1::LimitUse>& messages) {
  std::vector<LimitUse> uses;
  absl::Status status = check_range("limits", messages.size(), 0, kMaxLimitUses);
  for (const v1::LimitUse& message : messages) {
    status.Update(check_name("limits.limit", message.limit()));
    status.Update(check_range("limits.unit_count", message.unit_count(), 1, 1000));
    uses.push_back({message.limit(), message.unit_count()});
  }
  if (!status.ok()) return status;
  std::sort(uses.begin(), uses.end());
  const auto twice = std::adjacent_find(
      uses.begin(), uses.end(), [](const auto& a, const auto& b) { return a.limit == b.limit; });
  if (twice != uses.end()) return bad("limits", absl::StrCat(twice->limit, " is named twice"));
  return uses;
}

absl::Status read_dependencies(const v1::CreateJobRequest& request, JobSpec& spec) {
  absl::Status status =
      check_range("dependencies", request.dependencies_size(), 0, kMaxDependencies);
  for (const v1::JobDependency& message : request.dependencies()) {
    if (message.kind() < v1::JobDependency::KIND_SUCCESS ||
        message.kind() > v1::JobDependency::KIND_FRAMES) {
      status.Update(bad("dependencies.kind", absl::StrCat(message.kind(), " is unknown")));
    }
    status.Update(check_text("dependencies.job_id", message.job_id(), 1, kMaxIdLetters));
    spec.after.push_back({message.job_id(), static_cast<Dependency::Kind>(message.kind())});
  }
  return status;
}

void write_limits(const std::vector<LimitUse>& uses,
                  google::protobuf::RepeatedPtrField<v1::LimitUse>& messages) {
  messages.Clear();
  for (const LimitUse& use : uses) {
    v1::LimitUse* message = messages.Add();
    message->set_limit(use.limit);
    message->set_unit_count(use.units);
  }
}

void write_dependencies(const std::vector<Dependency>& after,
                        google::protobuf::RepeatedPtrField<v1::JobDependency>& messages) {
  messages.Clear();
  for (const Dependency& dependency : after) {
    v1::JobDependency* message = messages.Add();
    message->set_job_id(dependency.job_id);
    message->set_kind(static_cast<v1::JobDependency::Kind>(dependency.kind));
  }
}

/// to_spec() without check_texts(): a stored job may predate a limit.
absl::StatusOr<JobSpec> parse_spec(const v1::CreateJobRequest& request, const std::string& owner) {
  JobSpec spec;
  spec.request_id = request.request_id();
  spec.name = request.name();
  spec.owner = owner;
  spec.priority = request.priority();
  spec.max_workers = request.max_worker_count();
  spec.required_tag = request.required_tag();
  spec.scene_warnings = {request.scene_warnings().begin(), request.scene_warnings().end()};
  absl::Status status = check_range("priority", spec.priority, -100, 100);
  status.Update(check_range("max_worker_count", spec.max_workers, 0, 1'000'000));
  status.Update(read_dependencies(request, spec));
  if (!status.ok()) return status;
  auto limits = read_limits(request.limits());
  if (!limits.ok()) return limits.status();
  spec.pool = request.pool();
  spec.project = request.project();
  spec.blocked_workers = {request.blocked_worker_ids().begin(), request.blocked_worker_ids().end()};
  spec.limits = *std::move(limits);
  const auto settings = contract::from_message(request.settings());
  if (!settings.ok()) return settings.status();
  spec.settings = *settings;
  status.Update(check_tiles(spec.settings));
  status.Update(read_manifest(request.manifest(), spec));
  status.Update(read_references(request, spec));
  if (!status.ok()) return status;
  spec.request = request.SerializeAsString();
  return spec;
}

}  // namespace

absl::StatusOr<JobAdmin::Update> from_message(const v1::UpdateJobRequest& message) {
  JobAdmin::Update update;
  absl::Status status;
  if (message.has_priority()) {
    update.priority = message.priority();
    status.Update(check_range("priority", message.priority(), -100, 100));
  }
  if (message.has_max_worker_count()) {
    update.max_workers = message.max_worker_count();
    status.Update(check_range("max_worker_count", message.max_worker_count(), 0, 1'000'000));
  }
  if (message.has_required_tag()) {
    update.required_tag = message.required_tag();
    status.Update(check_text("required_tag", message.required_tag(), 0, kMaxIdLetters));
  }
  if (message.has_pool()) {
    update.pool = message.pool();
    if (!message.pool().empty()) status.Update(check_name("pool", message.pool()));
  }
  update.clear_dependencies = message.clear_dependencies();
  status.Update(check_workers("block_worker_ids", message.block_worker_ids()));
  status.Update(check_workers("unblock_worker_ids", message.unblock_worker_ids()));
  update.block_workers = {message.block_worker_ids().begin(), message.block_worker_ids().end()};
  update.unblock_workers = {message.unblock_worker_ids().begin(),
                            message.unblock_worker_ids().end()};
  if (!status.ok()) return status;
  if (!message.has_limits()) return update;
  auto limits = read_limits(message.limits().limits());
  if (!limits.ok()) return limits.status();
  update.limits = *std::move(limits);
  return update;
}

absl::StatusOr<JobFilter> to_filter(const v1::ListJobsRequest& request) {
  JobFilter filter;
  absl::Status status = read_filter("owners", request.owners(), filter.owners);
  status.Update(read_filter("projects", request.projects(), filter.projects));
  status.Update(read_filter("pools", request.pools(), filter.pools));
  status.Update(check_range("states", request.states_size(), 0, kMaxFilterValues));
  for (const int state : request.states()) {
    status.Update(check_range("states", state, v1::Job::STATE_QUEUED, v1::Job::STATE_CANCELLED));
    filter.states.insert(static_cast<JobState>(state));
  }
  if (!status.ok()) return status;
  return filter;
}

absl::StatusOr<JobSpec> to_spec(const v1::CreateJobRequest& request, const std::string& owner) {
  absl::Status status = check_texts(request);
  if (!status.ok()) return status;
  return parse_spec(request, owner);
}

absl::StatusOr<JobSpec> read_spec(const JobRecord& record) {
  v1::CreateJobRequest request;
  if (!request.ParseFromString(record.request)) {
    return absl::DataLossError(absl::StrCat("job ", record.id, ": cannot parse its request"));
  }
  auto spec = parse_spec(request, record.owner);
  if (!spec.ok()) {
    return absl::DataLossError(
        absl::StrCat("job ", record.id, ": ", std::string(spec.status().message())));
  }
  spec->id = record.id;
  spec->request = record.request;
  return spec;
}

std::string write_request(const JobSpec& spec) {
  v1::CreateJobRequest request;
  request.ParseFromString(spec.request);
  request.mutable_settings()->set_sample_count(spec.settings.spp);
  if (spec.settings.error) request.mutable_settings()->set_error_target(*spec.settings.error);
  request.set_priority(spec.priority);
  request.set_max_worker_count(spec.max_workers);
  request.set_required_tag(spec.required_tag);
  request.set_pool(spec.pool);
  write_limits(spec.limits, *request.mutable_limits());
  write_dependencies(spec.after, *request.mutable_dependencies());
  *request.mutable_blocked_worker_ids() = {spec.blocked_workers.begin(),
                                           spec.blocked_workers.end()};
  return request.SerializeAsString();
}

v1::FailedAttempt to_message(const FailedAttempt& attempt) {
  v1::FailedAttempt message;
  message.set_frame(attempt.unit.frame);
  message.set_tile(attempt.unit.tile);
  message.set_pass(attempt.unit.pass);
  message.set_worker_id(attempt.worker_id);
  message.set_message(cut_text(attempt.message, EventLog::kMaxTextBytes));
  return message;
}

v1::Job to_message(const JobView& view) {
  v1::Job job;
  job.set_id(view.spec->id);
  job.set_name(view.spec->name);
  job.set_owner(view.spec->owner);
  job.set_state(static_cast<v1::Job::State>(view.state));
  job.set_reason(view.reason);
  job.set_failure_code(static_cast<std::int32_t>(view.failure_code));
  job.set_priority(view.spec->priority);
  job.set_max_worker_count(view.spec->max_workers);
  job.set_required_tag(view.spec->required_tag);
  job.set_pool(view.spec->pool.empty() ? kDefaultPool : view.spec->pool);
  write_limits(view.spec->limits, *job.mutable_limits());
  write_dependencies(view.spec->after, *job.mutable_dependencies());
  job.set_project(view.spec->project);
  *job.mutable_blocked_worker_ids() = {view.spec->blocked_workers.begin(),
                                       view.spec->blocked_workers.end()};
  job.set_pause_cause(static_cast<v1::Job::PauseCause>(view.pause_cause));
  for (const FailedAttempt& attempt : view.failed_attempts) {
    *job.add_failed_attempts() = to_message(attempt);
  }
  set_time(view.create_time_us, *job.mutable_create_time());
  if (view.end_time_us != 0) set_time(view.end_time_us, *job.mutable_end_time());
  *job.mutable_settings() = contract::to_message(view.spec->settings);
  set_progress(view, *job.mutable_progress());
  if (view.certainty) job.set_certainty(static_cast<v1::Job::Certainty>(*view.certainty));
  return job;
}

v1::SceneManifest to_manifest(const JobSpec& spec) {
  v1::SceneManifest manifest;
  manifest.set_scene_uri(spec.scene_uri);
  for (const ManifestEntry& asset : spec.assets) {
    v1::ManifestEntry* entry = manifest.add_assets();
    entry->set_uri(asset.uri);
    entry->mutable_asset()->set_sha256(asset.digest.binary());
    entry->mutable_asset()->set_size_bytes(asset.size_bytes);
  }
  return manifest;
}

v1::JobDescription describe(const JobSpec& spec) {
  v1::JobDescription job;
  job.set_job_id(spec.id);
  *job.mutable_settings() = contract::to_message(spec.settings);
  *job.mutable_manifest() = to_manifest(spec);
  return job;
}

}  // namespace tessera::server
