#include "server/jobs/job_admission.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"

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
  return record;
}

}  // namespace

absl::Status check_owners_quota(const FarmView& farm, const ClientQuota& quota,
                                const JobSpec& spec) {
  if (!quota.has_limits()) return absl::OkStatus();
  Demand sum = farm.scheduler().demand(spec.owner);
  const Job* job = spec.id.empty() ? nullptr : farm.find_job(spec.id);
  if (job != nullptr && !has_ended(job->state)) {  // only the others count
    sum.jobs -= job->demand.jobs;
    sum.store_bytes -= job->demand.store_bytes;
    sum.samples -= job->demand.samples;
  }
  return check_quota(quota, OwnerUse{sum.jobs, sum.store_bytes, sum.samples}, spec);
}

void JobAdmission::create_job(JobSpec spec, OnCreated done) {
  pipeline_.post(
      [this, spec = std::move(spec), done = std::move(done)] { done(create_now(spec)); });
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

absl::Status JobAdmission::check_room(const JobSpec& spec, std::int64_t need_bytes) {
  if (absl::Status missing = assets_.check_present(spec); !missing.ok()) return missing;
  const std::int64_t left = farm_.options().quota_bytes - store_.used_bytes();
  if (need_bytes > left) {
    return absl::ResourceExhaustedError(absl::StrCat("the job needs up to ", need_bytes, " bytes; ",
                                                     std::max<std::int64_t>(left, 0),
                                                     " bytes remain of --quota-gb"));
  }
  const FarmView view(farm_);
  return check_owners_quota(view, farm_.options().client_quota, spec);
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
absl::Status JobAdmission::add_row(JobRecord& record) {
  absl::Status status;
  for (int attempt = 0; attempt < 4; ++attempt) {  // the ID of a removed job may be drawn again
    record.id = new_job_id();
    status = store_.add_job(record);
    if (!absl::IsAlreadyExists(status)) break;
  }
  return status;
}

absl::StatusOr<JobAdmission::Created> JobAdmission::create_now(const JobSpec& spec) {
  const std::int64_t store_bytes = max_job_size(spec).store_bytes;
  auto existing = find_existing(spec);
  if (!existing.ok()) return existing.status();
  if (*existing) return Created{**std::move(existing), store_bytes};
  if (absl::Status room = check_room(spec, store_bytes); !room.ok()) return room;
  JobRecord record = new_record(spec, farm_.options().wall_us());
  if (absl::Status added = add_row(record); !added.ok()) return added;
  auto job_spec = std::make_shared<JobSpec>(spec);
  job_spec->id = record.id;
  assets_.add_job(record.sequence, *job_spec);
  FarmChange change(farm_);
  Job& job = change.add_job(record.sequence, std::move(job_spec), JobState::queued);
  change.film(job).create_time_us = record.create_time_us;
  change.note(EventKind::job_submitted, job, "", record.name);
  change.scheduler().offer_work(change.now());
  return Created{change.view(job), store_bytes};
}

}  // namespace tessera::server
