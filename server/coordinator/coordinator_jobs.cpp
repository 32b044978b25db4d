#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/coordinator/coordinator.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr auto kAssetPin = std::chrono::hours(1);
constexpr int kIdLetters = 8;

/// Restores the sums over units whose rows are deleted.
absl::Status restore_totals(const Store& store, Scheduler& scheduler, Job& job) {
  const auto totals = store.totals(job.spec->id);
  if (!totals.ok()) return totals.status();
  for (const UnitTotals& total : *totals) {
    scheduler.restore_contribution(job, total.worker_id, {total.units, total.cpu_seconds});
    job.counters.audited += total.audited;
  }
  return absl::OkStatus();
}

/// Restores a job's units from the journal; those of unfinished frames also go to `visit_open`.
absl::Status restore_units(const Store& store, Scheduler& scheduler, Job& job,
                           const std::function<void(const UnitRecord&)>& visit_open) {
  if (absl::Status status = restore_totals(store, scheduler, job); !status.ok()) return status;
  const JobPlan& plan = job.open_plan();
  return store.for_each_unit(job.spec->id, [&](const UnitRecord& unit) {
    if (!plan.contains(unit.unit)) return;
    scheduler.restore_unit(job, unit.unit, unit.worker_id, unit.cpu_seconds);
    if (unit.audit == AuditState::ended) ++job.counters.audited;
    if (!plan.is_finished(unit.unit.frame)) visit_open(unit);
  });
}

/// Restores the cost of a job whose units this server does not read.
absl::Status restore_costs(const Store& store, Scheduler& scheduler, Job& job) {
  if (absl::Status status = restore_totals(store, scheduler, job); !status.ok()) return status;
  return store.for_each_unit(job.spec->id, [&](const UnitRecord& unit) {
    scheduler.restore_contribution(job, unit.worker_id, {1, unit.cpu_seconds});
  });
}

/// Returns whether any unit of the job has been rendered.
absl::StatusOr<bool> has_started(const Store& store, const std::string& job_id) {
  const auto frames = store.frames(job_id);
  if (!frames.ok()) return frames.status();
  bool started = !frames->empty();
  if (started) return true;
  absl::Status status = store.for_each_unit(job_id, [&](const UnitRecord&) { started = true; });
  if (!status.ok()) return status;
  return started;
}

/// Errors: FailedPrecondition, the job's blocks have another render contract: passes and sampling
/// may differ, and all of a frame must have one contract.
absl::Status check_contract(const JobSpec& spec) {
  if (spec.render_contract == contract::kRenderContract) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("job ", spec.id, " uses render contract ", spec.render_contract,
                   ", this server ", contract::kRenderContract, "; submit the job again"));
}

}  // namespace

absl::StatusOr<std::unique_ptr<Coordinator>> Coordinator::open(Store& store,
                                                               CoordinatorOptions options) {
  const auto roster = store.roster();
  if (!roster.ok()) return roster.status();
  const auto banned = store.banned_workers();
  if (!banned.ok()) return banned.status();
  const auto records = store.jobs();
  if (!records.ok()) return records.status();
  std::unique_ptr<Coordinator> coordinator(new Coordinator(store, std::move(options), *roster));
  if (absl::Status status = coordinator->load(*records, *banned); !status.ok()) return status;
  return coordinator;
}

absl::Status Coordinator::load(const std::vector<JobRecord>& records,
                               const std::vector<std::string>& banned) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  for (const std::string& worker_id : banned) scheduler_.ban(worker_id);
  for (const JobRecord& record : records) {
    if (absl::Status status = load_job(record); !status.ok()) return status;
  }
  apply_effects(deferred);
  return absl::OkStatus();
}

absl::Status Coordinator::load_job(const JobRecord& record) {
  auto spec = options_.read_spec(record);
  if (!spec.ok()) return spec.status();
  auto state = static_cast<JobState>(record.state);
  const bool is_current_contract = record.render_contract == contract::kRenderContract;
  bool started = true;
  if (state == JobState::queued || !is_current_contract) {
    const auto found = has_started(store_, record.id);
    if (!found.ok()) return found.status();
    started = *found;
  }
  if (started) spec->render_contract = record.render_contract;
  Job& job =
      scheduler_.add_job(record.sequence, std::make_shared<const JobSpec>(*std::move(spec)), state);
  note_demand(job);
  job.reason = record.reason;
  job.failure_code = static_cast<absl::StatusCode>(record.failure_code);
  job.wall_seconds_before = record.wall_seconds;
  job_by_request_[record.request_id] = record.sequence;
  JobFilm& film = job_film(job);
  film.create_time_us = record.create_time_us;
  film.end_time_us = record.end_time_us;
  film.wall_at_start = record.wall_seconds;
  if (!started && !is_current_contract)
    changed_.insert(job.key);  // none of its blocks has another contract
  if (!started && state == JobState::queued) return absl::OkStatus();
  const auto frames = store_.frames(record.id);
  if (!frames.ok()) return frames.status();
  JobPlan& plan = job.open_plan();
  for (const FrameRecord& frame : *frames) {
    const FrameSummary summary = read_frame_summary(frame.statistics_json);
    if (!summary.fits(job.spec->settings)) continue;
    count_finished(film, frame, summary);
    plan.finish(frame.frame, summary.unit_count);
    film.committed_samples += summary.samples;
  }
  const absl::Status same = check_contract(*job.spec);
  if (same.ok() || state == JobState::done) return load_units(job, record);
  if (!has_ended(state)) {
    scheduler_.fail_job(job, same, options_.clock());
  }
  return restore_costs(store_, scheduler_, job);
}

absl::Status Coordinator::load_units(Job& job, const JobRecord& record) {
  JobPlan& plan = job.open_plan();
  JobFilm& film = job_film(job);
  const bool has_open_frames = plan.finished_frame_count() < plan.frame_count();
  const contract::TileGrid* grid = has_open_frames ? &tile_grid(job) : nullptr;
  BlockIndex* block_index = has_open_frames ? &open_block_index(job) : nullptr;
  Scheduler* const scheduler = &scheduler_;  // thread-safety analysis does not look into the lambda
  absl::Status status = restore_units(
      store_, *scheduler, job, [&, wall = record.wall_seconds](const UnitRecord& unit) {
        block_index->add(unit, wall);
        if (unit.audit == AuditState::open) {
          scheduler->open_audit(job, unit.unit, unit.worker_id, unit.sha256);
        }
        const contract::PixelRect rect = grid->rect(unit.unit.tile);
        film.committed_samples +=
            std::int64_t{rect.width} * rect.height *
            plan.passes()[static_cast<std::size_t>(unit.unit.pass)].sample_count;
      });
  if (!status.ok()) return status;
  film.samples_at_start = film.committed_samples;
  if (has_ended(job.state)) return absl::OkStatus();
  for (const std::int32_t frame : plan.frames()) finish_if_complete(job, frame);
  open_films(job);
  if (plan.finished_frame_count() == plan.frame_count()) {
    scheduler_.end_job(job, JobState::done, "", options_.clock());
  }
  return absl::OkStatus();
}

std::string Coordinator::new_job_id() {
  constexpr char kLetters[] = "abcdefghjkmnpqrstuvwxyz23456789_";  // 32; the last is never used
  while (true) {
    std::string id;
    std::uint64_t bits = options_.random();
    for (int i = 0; i < kIdLetters; ++i, bits >>= 5) id.push_back(kLetters[(bits & 31) % 31]);
    const bool is_name = id.find_first_not_of("0123456789") == std::string::npos;
    if (!is_name && scheduler_.find_job(id) == nullptr) return id;
  }
}

void Coordinator::create_job(JobSpec spec, OnCreated done) {
  post_to_writer(
      [this, spec = std::move(spec), done = std::move(done)] { create_now(spec, done); });
}

absl::Status Coordinator::check_room(const JobSpec& spec, std::int64_t need_bytes) {
  for (const ManifestEntry& entry : spec.assets) {
    if (has_asset(entry.digest)) continue;
    return absl::FailedPreconditionError(
        absl::StrCat("manifest: asset ", entry.digest.hex(), " (", entry.uri,
                     ") has not been uploaded; upload it and repeat"));
  }
  for (const contract::Digest& digest : spec.references) {
    if (has_asset(digest)) continue;
    return absl::FailedPreconditionError(absl::StrCat(
        "references: asset ", digest.hex(), " has not been uploaded; upload it and repeat"));
  }
  const std::int64_t left = options_.quota_bytes - store_.used_bytes();
  if (need_bytes <= left) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrCat("the job needs up to ", need_bytes, " bytes; ",
                                                   std::max<std::int64_t>(left, 0),
                                                   " bytes remain of --quota-gb"));
}

/// Tells the scheduler what the job may need at most, for the owner's quota.
void Coordinator::note_demand(Job& job) {
  const JobSize size = max_job_size(*job.spec);
  scheduler_.set_demand(job, static_cast<double>(size.store_bytes), size.samples);
}

/// Checks the owner's quota with this job in its new form.
absl::Status Coordinator::check_owners_quota(const JobSpec& spec) const {
  if (!options_.client_quota.has_limits()) return absl::OkStatus();
  Demand sum = scheduler_.demand(spec.owner);
  const Job* job = spec.id.empty() ? nullptr : scheduler_.find_job(spec.id);
  if (job != nullptr && !has_ended(job->state)) {  // only the others count
    sum.jobs -= job->demand.jobs;
    sum.store_bytes -= job->demand.store_bytes;
    sum.samples -= job->demand.samples;
  }
  const OwnerUse use{sum.jobs, sum.store_bytes, sum.samples};
  return check_quota(options_.client_quota, use, spec);
}

void Coordinator::create_now(const JobSpec& spec, const OnCreated& done) {
  Created created;
  created.store_bytes = max_job_size(spec).store_bytes;
  const auto find_existing = [&]() -> bool {
    MutexLock lock(mutex_);
    const auto existing = job_by_request_.find(spec.request_id);
    const Job* job =
        existing == job_by_request_.end() ? nullptr : scheduler_.find_job(existing->second);
    if (job != nullptr) created.view = view(*job);
    return job != nullptr;
  };
  if (find_existing()) {
    if (created.view.spec->owner == spec.owner) return done(created);
    return done(absl::AlreadyExistsError("request_id: used by another client"));
  }
  absl::Status status = check_room(spec, created.store_bytes);
  if (status.ok()) {
    MutexLock lock(mutex_);
    status = check_owners_quota(spec);
  }
  if (!status.ok()) return done(status);
  JobRecord record;
  record.request_id = spec.request_id;
  record.name = spec.name;
  record.owner = spec.owner;
  record.request = spec.request;
  record.state = static_cast<std::int32_t>(JobState::queued);
  record.create_time_us = options_.wall_us();
  record.render_contract = spec.render_contract;
  for (int attempt = 0; attempt < 4; ++attempt) {  // the ID of a removed job may be drawn again
    {
      MutexLock lock(mutex_);
      record.id = new_job_id();
    }
    status = store_.add_job(record);
    if (!absl::IsAlreadyExists(status)) break;
  }
  if (!status.ok()) return done(status);
  {
    DeferredCalls deferred;
    MutexLock lock(mutex_);
    auto job_spec = std::make_shared<JobSpec>(spec);
    job_spec->id = record.id;
    Job& job = scheduler_.add_job(record.sequence, std::move(job_spec), JobState::queued);
    note_demand(job);
    job_by_request_[spec.request_id] = record.sequence;
    job_film(job).create_time_us = record.create_time_us;
    note(EventKind::job_submitted, job, "", record.name);
    scheduler_.offer_work(options_.clock());
    created.view = view(job);
    apply_effects(deferred);
  }
  done(created);
}

void Coordinator::change_job(const std::string& job_id, Change change, const OnJob& done) {
  absl::Status status;
  {
    DeferredCalls deferred;
    MutexLock lock(mutex_);
    Job* job = scheduler_.find_job(job_id);
    const Time now = options_.clock();
    if (job == nullptr) {
      status = absl::NotFoundError(absl::StrCat("no job \"", job_id, "\""));
    } else if (change == Change::pause) {
      status = scheduler_.pause(*job, "paused by the user", now);
    } else if (change == Change::resume) {
      status = scheduler_.resume(*job, now);
      if (status.ok()) finish_complete_frames(*job);
    } else if (change == Change::cancel) {
      status = scheduler_.cancel(*job, now);
    } else {
      status = check_contract(*job->spec);
      status.Update(check_owners_quota(*job->spec));
      if (status.ok()) status = scheduler_.retry(*job, now);
      if (status.ok()) finish_complete_frames(*job);
    }
    apply_effects(deferred);
    if (status.ok()) {
      after_journal_.emplace_back([this, job_id, done] { done(this->job(job_id)); });
      writer_wakeup_.notify_all();
    }
  }
  if (!status.ok()) done(status);
}

/// Finishes frames that were completed while the job was paused.
void Coordinator::finish_complete_frames(Job& job) {
  if (!job.plan) return;
  for (const std::int32_t frame : job.plan->frames()) finish_if_complete(job, frame);
  open_films(job);
}

void Coordinator::extend_job(const std::string& job_id, const Extension& extension, OnJob done) {
  post_to_writer(
      [this, job_id, extension, done = std::move(done)] { extend_now(job_id, extension, done); });
}

/// Returns the spec of the extended job, if it can be extended. On the writer thread.
absl::StatusOr<std::shared_ptr<JobSpec>> Coordinator::spec_to_extend(
    const std::string& job_id, const Extension& extension) const {
  MutexLock lock(mutex_);
  const Job* job = scheduler_.find_job(job_id);
  if (job == nullptr) return absl::NotFoundError(absl::StrCat("no job \"", job_id, "\""));
  if (job->state == JobState::done) {
    return absl::FailedPreconditionError(
        absl::StrCat("job ", job_id, " is done and its blocks are deleted; submit a new job"));
  }
  if (absl::Status status = check_contract(*job->spec); !status.ok()) return status;
  const contract::RenderSettings& present = job->spec->settings;
  const std::int32_t spp = extension.spp.value_or(present.spp);
  if (spp < present.spp || spp > contract::kMaxSpp) {
    return absl::InvalidArgumentError(absl::StrCat("sample_count: ", spp, " is not in [",
                                                   present.spp, ", ", contract::kMaxSpp, "]"));
  }
  const std::optional<double> error = extension.error ? extension.error : present.error;
  if (extension.error && !(*error > 0 && *error <= present.error.value_or(1))) {
    return absl::InvalidArgumentError(
        absl::StrCat("error_target: ", *error, " is not in (0, ", present.error.value_or(1), "]"));
  }
  auto spec = std::make_shared<JobSpec>(*job->spec);
  spec->settings.spp = spp;
  spec->settings.error = error;
  if (absl::Status status = check_owners_quota(*spec); !status.ok()) return status;
  return spec;
}

void Coordinator::extend_now(const std::string& job_id, const Extension& extension,
                             const OnJob& done) {
  const auto found = spec_to_extend(job_id, extension);
  if (!found.ok()) return done(found.status());
  const std::shared_ptr<JobSpec>& spec = *found;
  contract::RenderSettings present;
  {
    MutexLock lock(mutex_);
    present = scheduler_.find_job(job_id)->spec->settings;
  }
  if (spec->settings.spp == present.spp && spec->settings.error == present.error) {
    return done(job(job_id));  // without the lock, like all callbacks
  }
  const std::vector<contract::Pass> before = contract::schedule(present);
  spec->request = options_.write_request(*spec);
  const auto passes = contract::schedule(spec->settings);
  std::vector<Unit> dropped;
  std::vector<UnitRecord> kept;
  absl::Status status = store_.for_each_unit(job_id, [&](const UnitRecord& record) {
    const auto pass = static_cast<std::size_t>(record.unit.pass);
    if (pass < before.size() && pass < passes.size() && before[pass] == passes[pass]) {
      kept.push_back(record);
    } else {
      dropped.push_back(record.unit);
    }
  });
  if (status.ok() && !dropped.empty()) status = store_.drop_units(job_id, dropped);
  if (!status.ok()) return done(status);
  replan(job_id, spec, kept);
  journal_changes();
  done(job(job_id));
}

/// Restarts a job with new settings, keeping the units that remain valid.
void Coordinator::replan(const std::string& job_id, const std::shared_ptr<const JobSpec>& spec,
                         const std::vector<UnitRecord>& kept) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  Job* job = scheduler_.find_job(job_id);
  JobFilm& film = job_film(*job);
  scheduler_.extend(*job, spec);
  note_demand(*job);
  film.block_index.reset();
  film.finished.clear();
  film.expected_samples.clear();
  film.certainty.reset();
  film.committed_samples = film.finished_samples = 0;
  for (const UnitRecord& record : kept) {
    scheduler_.restore_unit(*job, record.unit, record.worker_id, record.cpu_seconds);
    open_block_index(*job).add(record, job->wall_seconds(options_.clock()));
    const contract::PixelRect rect = tile_grid(*job).rect(record.unit.tile);
    const auto pass = static_cast<std::size_t>(record.unit.pass);
    film.committed_samples +=
        std::int64_t{rect.width} * rect.height * job->plan->passes()[pass].sample_count;
  }
  film.samples_at_start = film.committed_samples;
  film.wall_at_start = job->wall_seconds(options_.clock());
  for (const std::int32_t frame : job->plan->frames()) {
    enqueue_film([this, key = FrameKey{job_id, frame}] { film_.close_frame(key); });
  }
  open_films(*job);
  scheduler_.offer_work(options_.clock());
  apply_effects(deferred);
}

void Coordinator::remove_job(const std::string& job_id, std::function<void(absl::Status)> done) {
  post_to_writer([this, job_id, done = std::move(done)] { remove_now(job_id, done); });
}

absl::Status Coordinator::forget_job(const std::string& job_id,
                                     std::vector<contract::Digest>& assets) {
  MutexLock lock(mutex_);
  Job* job = scheduler_.find_job(job_id);
  if (job == nullptr) return absl::NotFoundError(absl::StrCat("no job \"", job_id, "\""));
  if (!has_ended(job->state)) {
    return absl::FailedPreconditionError(
        absl::StrCat("job ", job_id, " has not ended; cancel it first"));
  }
  if (job->plan) {
    for (const std::int32_t frame : job->plan->frames()) {
      enqueue_film([this, key = FrameKey{job_id, frame}] { film_.close_frame(key); });
    }
  }
  assets = job->spec->asset_digests();
  films_.erase(job->key);
  note(EventKind::job_removed, *job, "", "");
  scheduler_.remove_job(job->key);
  return absl::OkStatus();
}

void Coordinator::remove_now(const std::string& job_id,
                             const std::function<void(absl::Status)>& done) {
  std::vector<contract::Digest> assets;
  if (absl::Status status = forget_job(job_id, assets); !status.ok()) return done(status);
  absl::Status status = store_.remove_job(job_id);
  status.Update(store_.release_assets(assets));
  collect_assets();
  done(status);
}

// Assets -----------------------------------------------------------------------------------------

bool Coordinator::has_asset(const contract::Digest& digest) {
  if (!store_.has_asset(digest)) return false;
  MutexLock lock(mutex_);
  asset_requests_[digest] = options_.clock();
  return true;
}

void Coordinator::publish_asset(const std::string& upload_path, const contract::Digest& digest,
                                std::function<void(absl::Status)> done) {
  post_to_writer([this, upload_path, digest, done = std::move(done)] {
    const absl::Status status = store_.publish_asset(upload_path, digest);
    if (store_.used_bytes() > options_.asset_quota_bytes) collect_assets();
    done(status);
  });
}

void Coordinator::collect_assets() {
  std::vector<contract::Digest> named;
  {
    MutexLock lock(mutex_);
    const Time now = options_.clock();
    for (auto it = asset_requests_.begin(); it != asset_requests_.end();) {
      if (now - it->second > kAssetPin) {
        it = asset_requests_.erase(it);
      } else {
        named.push_back(it++->first);
      }
    }
    for (const auto& [key, job] : scheduler_.jobs()) {
      const std::vector<contract::Digest> digests = job.spec->asset_digests();
      named.insert(named.end(), digests.begin(), digests.end());
    }
  }
  const absl::Status status =
      store_.collect_assets(options_.wall_us(), options_.asset_quota_bytes, named);
  if (!status.ok()) log(LogLevel::error, absl::StrCat("assets: ", status.ToString()));
}

}  // namespace tessera::server
