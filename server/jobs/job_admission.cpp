#include "server/jobs/job_admission.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera::server {
namespace {

constexpr int kIdLetters = 8;

JobRecord new_record(const JobSpec& spec, std::int64_t create_time_us) {
  JobRecord record;
  record.request_id = spec.request_id;
  record.name = spec.name;
  record.owner = spec.owner;
  record.request = spec.request;
  record.state = static_cast<std::int32_t>(JobState::queued);
  record.create_time_us = create_time_us;
  record.render_contract = spec.render_contract;
  record.project = spec.project;
  return record;
}

/// Errors: NotFound, a job that this one waits for does not exist or belongs to another owner;
/// InvalidArgument, it lacks a frame.
absl::Status check_dependencies(const FarmView& farm, const JobSpec& spec,
                                const std::string& visible_owner) {
  for (const Dependency& dependency : spec.after) {
    const Job* other = farm.find_job(dependency.job_id);
    if (other == nullptr || (!visible_owner.empty() && other->spec->owner != visible_owner)) {
      return absl::NotFoundError(absl::StrCat("dependencies: no job \"", dependency.job_id, "\""));
    }
    if (dependency.kind != Dependency::Kind::frames) continue;
    const std::vector<std::int32_t> theirs = contract::frame_list(other->spec->settings.frames);
    for (const std::int32_t frame : contract::frame_list(spec.settings.frames)) {
      if (std::binary_search(theirs.begin(), theirs.end(), frame)) continue;
      return absl::InvalidArgumentError(absl::StrCat("dependencies: job ", dependency.job_id,
                                                     " has no frame ", frame, " to wait for"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status check_owners_quota(const FarmView& farm, const JobSpec& spec, OwnerUse use) {
  use += farm.owner_use(spec.owner);
  const Job* job = spec.id.empty() ? nullptr : farm.find_job(spec.id);
  if (job != nullptr) {  // only the others count
    if (!has_ended(job->state)) {
      use.jobs -= job->demand.jobs;
      use.store_bytes -= job->demand.store_bytes;
      use.samples -= job->demand.samples;
    }
    use.kept_bytes -= static_cast<double>(farm.kept_bytes(*job));
  }
  const QuotaKind* refused = nullptr;
  absl::Status status =
      check_quota(farm.options().client_quotas.of(spec.owner), use, spec, &refused);
  if (refused != nullptr) farm.options().metrics->quota_refused(refused->name);
  return status;
}

absl::Status check_limits_exist(const FarmView& farm, const std::vector<LimitUse>& uses) {
  const Limits& limits = farm.scheduler().limits().table();
  for (const LimitUse& use : uses) {
    if (!limits.has(use.limit)) {
      return absl::NotFoundError(
          absl::StrCat("limits: no limit \"", use.limit,
                       "\"; an operator creates it with `tessera limits set ", use.limit, " N`"));
    }
    // A limit of 0 stops jobs for a while; they may wait for it.
    const std::int64_t units = *limits.all().at(use.limit).units;
    if (units > 0 && use.units > units) {
      return absl::InvalidArgumentError(
          absl::StrCat("limits: limit ", use.limit, " has ", units, units == 1 ? " unit" : " units",
                       ", each unit of work of this job needs ", use.units, "; use at most ", units,
                       ", or ask the operator to raise the limit"));
    }
  }
  return absl::OkStatus();
}

void JobAdmission::create_job(JobSpec spec, OnCreated done, std::string visible_owner) {
  const std::int64_t store_bytes = max_job_size(spec).store_bytes;
  const auto request = std::make_shared<Request>(
      Request{std::move(spec), {}, store_bytes, std::move(visible_owner)});
  pipeline_.post_write([this, request] { return write(request); },
                       [this, request, done = std::move(done)](const absl::Status& status) {
                         done(answer(request, status));
                       });
}

/// Writes the job's row. The checks read the farm within the transaction, because their outcome
/// depends on which earlier jobs of the same transaction could be written. On a full disk the
/// transaction may be tried twice, so this forgets the request of the first attempt.
absl::Status JobAdmission::write(const std::shared_ptr<Request>& request) {
  {
    const MutexLock lock(mutex_);
    std::erase(written_, request);
  }
  absl::Status status = check_room(*request);
  if (status.ok()) status = add_row(*request);
  if (!status.ok()) return status;
  const MutexLock lock(mutex_);
  written_.push_back(request);
  return status;
}

/// Returns the job that the same request created before. Errors: AlreadyExists, it belongs to
/// another client.
absl::StatusOr<std::optional<JobView>> JobAdmission::find_existing(const JobSpec& spec) const {
  const FarmView view(farm_);
  const JobKey key = view.index().of_request(spec.request_id);
  if (key == 0) return std::nullopt;
  const Job& job = view.scheduler().jobs().at(key);
  if (job.spec->owner == spec.owner) return view.view(job);
  return absl::AlreadyExistsError("request_id: used by another client");
}

/// Errors: AlreadyExists, the request has created a job.
absl::Status JobAdmission::check_new(const JobSpec& spec) {
  const MutexLock lock(mutex_);
  const bool is_repeated = std::any_of(written_.begin(), written_.end(), [&](const auto& other) {
    return !spec.request_id.empty() && other->spec.request_id == spec.request_id;
  });
  const auto existing = find_existing(spec);
  if (!is_repeated && existing.ok() && !existing->has_value()) return absl::OkStatus();
  return absl::AlreadyExistsError("request_id");
}

/// Errors: those of check_owners_quota().
absl::Status JobAdmission::check_owner(const JobSpec& spec) {
  OwnerUse use;
  use.kept_bytes = static_cast<double>(assets_.bytes_of(spec.owner));
  const MutexLock lock(mutex_);
  for (const auto& other : written_) {
    if (other->spec.owner == spec.owner) use.add(other->spec);
  }
  const FarmView view(farm_);
  return check_owners_quota(view, spec, use);
}

/// Errors: ResourceExhausted, a job that may need `bytes` would soon pause because the disk is
/// full.
absl::Status JobAdmission::check_disk(std::int64_t bytes) const {
  const std::int64_t free = store_.free_bytes();
  if (free >= std::min(bytes, kRoomForJobs)) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrFormat(
      "the disk of %s has only %.1f MB free, and the job may need %.1f MB: free space on it, or "
      "remove ended jobs with `tessera remove`, then submit again",
      store_.folder(), static_cast<double>(free) / 1e6, static_cast<double>(bytes) / 1e6));
}

/// Errors: AlreadyExists, the request has created a job; FailedPrecondition, an asset is missing;
/// ResourceExhausted, no room for the job.
absl::Status JobAdmission::check_room(const Request& request) {
  const JobSpec& spec = request.spec;
  if (absl::Status repeated = check_new(spec); !repeated.ok()) return repeated;
  if (absl::Status missing = assets_.check_present(spec); !missing.ok()) return missing;
  {
    const FarmView view(farm_);
    absl::Status status = check_dependencies(view, spec, request.visible_owner);
    status.Update(check_limits_exist(view, spec.limits));
    if (!status.ok()) return status;
  }
  if (absl::Status full = check_disk(request.store_bytes); !full.ok()) return full;
  const std::int64_t left = farm_.options().quota_bytes - store_.used_bytes();
  if (request.store_bytes > left) {
    return absl::ResourceExhaustedError(absl::StrCat("the job needs up to ", request.store_bytes,
                                                     " bytes; ", std::max<std::int64_t>(left, 0),
                                                     " bytes remain of --quota-gb"));
  }
  return check_owner(spec);
}

std::string JobAdmission::new_job_id() {
  constexpr char kLetters[] = "abcdefghjkmnpqrstuvwxyz23456789_";  // 32; the last is never used
  const FarmView view(farm_);
  while (true) {
    std::string id;
    std::uint64_t bits = farm_.options().random();
    for (int i = 0; i < kIdLetters; ++i, bits >>= 5) id.push_back(kLetters[(bits & 31) % 31]);
    const bool is_name = id.find_first_not_of("0123456789") == std::string::npos;
    if (!is_name && view.find_job(id) == nullptr) return id;
  }
}

/// Adds a row under a new ID.
absl::Status JobAdmission::add_row(Request& request) {
  request.record = new_record(request.spec, farm_.options().wall_us());
  absl::Status status;
  for (int attempt = 0; attempt < 4; ++attempt) {  // the ID of a removed job may be drawn again
    request.record.id = new_job_id();
    status = store_.jobs().add(request.record);
    if (!absl::IsAlreadyExists(status)) break;
  }
  const JobRecord& job = request.record;
  if (status.ok()) {
    pipeline_.tell({0, 0, EventKind::job_submitted, job.id, job.owner, "", job.name});
  }
  return status;
}

/// Returns the answer to a request, whose row was written with this outcome.
absl::StatusOr<JobAdmission::Created> JobAdmission::answer(const std::shared_ptr<Request>& request,
                                                           const absl::Status& status) {
  const MutexLock lock(mutex_);  // the writer counts the job once, here or among the farm's
  std::erase(written_, request);
  if (status.ok()) return Created{add(*request), request->store_bytes};
  if (!absl::IsAlreadyExists(status)) return status;
  auto existing = find_existing(request->spec);
  if (!existing.ok()) return existing.status();
  if (!existing->has_value()) return status;
  return Created{**std::move(existing), request->store_bytes};
}

/// Adds the job of a row that is durable.
JobView JobAdmission::add(const Request& request) {
  const JobRecord& record = request.record;
  auto spec = std::make_shared<JobSpec>(request.spec);
  spec->id = record.id;
  assets_.add_job(record.sequence, *spec);
  FarmChange change(farm_);
  Job& job = change.add_job(record.sequence, std::move(spec), JobState::queued);
  change.film(job).create_time_us = record.create_time_us;
  change.scheduler().dispatcher().dispatch_all(change.now());
  return change.view(job);
}

}  // namespace tessera::server
