#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/coordinator/coordinator.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr std::size_t kGroupUnits =
    1024;  // units per group; bounds the latency of acknowledgements
constexpr std::int64_t kGroupBytes = std::int64_t{64} << 20;
constexpr std::int64_t kDroppedEntryBytes = 12;

/// Memory of a waiting block: its bytes and the decoded copy.
std::int64_t weight(const BlockHeader& header) {
  return 2 * header.size_bytes;
}

absl::Status check_size(const BlockHeader& header, const contract::FilmBlockShape& shape) {
  const std::int64_t fixed = contract::film_block_bytes(shape);
  const std::int64_t max_bytes =
      fixed + kDroppedEntryBytes * shape.pixel_count() * contract::kReplicates;
  const std::int64_t extra = header.size_bytes - fixed;
  if (extra >= 0 && header.size_bytes <= max_bytes && extra % kDroppedEntryBytes == 0) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrCat("size_bytes: ", header.size_bytes, ", expected ",
                                                 fixed, " plus 12 per dropped ", "entry, at most ",
                                                 (max_bytes - fixed) / 12, " entries"));
}

}  // namespace

/// A group of delivered blocks with their outcomes.
struct Coordinator::CheckedGroup {
  std::vector<Commit> commits;
  std::vector<Delivered> committed;  // in the order of `commits`
  std::vector<Delivered> repeats;    // of units earlier in the same group
};

absl::Status Coordinator::check_delivery(const std::string& worker_id,
                                         const std::string& certificate) {
  MutexLock lock(mutex_);
  const Worker* worker = scheduler_.find_worker(worker_id);
  if (worker == nullptr || !worker->connected || worker->certificate != certificate) {
    return absl::FailedPreconditionError("this worker has no open Work stream; open one first");
  }
  scheduler_.record_contact(worker->key, options_.clock());
  return absl::OkStatus();
}

void Coordinator::acknowledge(const std::string& worker_id, const std::string& job_id,
                              const Unit& unit, AckStatus status, const std::string& reason) {
  options_.metrics->acknowledgement(status).Increment();
  const Worker* worker = scheduler_.find_worker(worker_id);
  if (worker != nullptr) scheduler_.acknowledge(worker->key, {{job_id, unit}, status, reason});
}

void Coordinator::reject(const std::string& worker_id, const BlockHeader& header,
                         const std::string& reason, DeferredCalls& deferred) {
  Worker* worker = scheduler_.find_worker(worker_id);
  if (worker == nullptr) return;
  options_.metrics->errors.block_rejected.Increment();
  deferred.add(
      [this, text = absl::StrCat("worker ", worker_id, ": block of job ", header.lease.job_id,
                                 " rejected: ", reason)] { log(LogLevel::warn, text); });
  acknowledge(worker_id, header.lease.job_id, header.unit(), AckStatus::rejected, reason);
  scheduler_.fail_unit(worker->key, header.lease, header.tile,
                       {worker_id, absl::StrCat("block rejected: ", reason), ""},
                       absl::StatusCode::kDataLoss, options_.clock());
}

void Coordinator::answer_obsolete(const std::string& worker_id, const BlockHeader& header) {
  acknowledge(worker_id, header.lease.job_id, header.unit(), AckStatus::obsolete, "");
  Job* job = scheduler_.find_job(header.lease.job_id);
  if (job == nullptr) return;
  job->counters.wasted_cpu_seconds += header.cpu_seconds;
  if (job->plan) scheduler_.release_duplicate(*job, header.unit(), worker_id);
}

/// Acknowledges a unit that is already committed; returns false if it is not.
bool Coordinator::handle_duplicate(Job& job, const std::string& worker_id,
                                   const BlockHeader& header) {
  const BlockIndex& block_index = open_block_index(job);
  const BlockIndex::BlockLocation* found = block_index.find(header.unit());
  if (found == nullptr) return false;
  const BlockIndex::BlockLocation location = *found;
  const bool is_answer =
      scheduler_.answer_audit(job, header.unit(), header.lease, {worker_id, header.sha256},
                              {block_index.worker(location), location.sha256}, options_.clock());
  if (!is_answer) ++job.counters.duplicated;
  deliveries_.add({.job = job.key,
                   .unit = header.unit(),
                   .worker_id = worker_id,
                   .outcome = is_answer ? DeliveryOutcome::audit : DeliveryOutcome::duplicate,
                   .end_us = options_.wall_us(),
                   .cpu_seconds = header.cpu_seconds});
  job.counters.wasted_cpu_seconds += header.cpu_seconds;
  scheduler_.release_duplicate(job, header.unit(), worker_id);
  if (location.sha256 == header.sha256) {
    acknowledge(worker_id, header.lease.job_id, header.unit(), AckStatus::duplicate, "");
  } else {
    ++job.counters.mismatched;
    options_.metrics->results_mismatched.Increment();
    acknowledge(worker_id, header.lease.job_id, header.unit(), AckStatus::rejected,
                "result differs from the committed one");
  }
  return true;
}

std::optional<Admission> Coordinator::admit(const std::string& worker_id,
                                            const BlockHeader& header) {
  const bool is_sealed = is_seal_valid(header.lease, worker_id, store_.key());
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  std::optional<Admission> admission;
  Job* job = scheduler_.find_job(header.lease.job_id);
  if (!is_sealed) {
    acknowledge(worker_id, header.lease.job_id, header.unit(), AckStatus::rejected,
                "invalid seal: this store did not grant the lease to this worker");
  } else if (job == nullptr) {
    answer_obsolete(worker_id, header);
  } else {
    if (!has_ended(job->state)) job->open_plan();
    if (!scheduler_.wants(*job, header.lease, header.unit())) {
      answer_obsolete(worker_id, header);
    } else {
      const contract::PixelRect rect = tile_grid(*job).rect(header.tile);
      const Admission candidate{
          {rect.width, rect.height, job->spec->settings.aovs, header.lease.pass == 0},
          header.lease.sample_count};
      const absl::Status size = check_size(header, candidate.shape);
      if (size.ok()) {
        admission = candidate;
      } else {
        reject(worker_id, header, std::string(size.message()), deferred);
      }
    }
  }
  apply_effects(deferred);
  return admission;
}

void Coordinator::deliver(const std::string& worker_id, const BlockHeader& header,
                          const Admission& admission, std::string bytes) {
  std::string fault;
  absl::StatusOr<contract::FilmBlock> block = absl::InternalError("not decoded");
  if (contract::sha256(bytes) != header.sha256) {
    fault = "its bytes do not match sha256";
  } else {
    block = contract::decode(bytes, admission.shape, admission.sample_count);
    if (!block.ok()) fault = std::string(block.status().message());
  }
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  if (!fault.empty()) {
    reject(worker_id, header, fault, deferred);
    apply_effects(deferred);
    return;
  }
  ingest_bytes_ += weight(header);
  delivered_.push_back({worker_id, header, *std::move(block), std::move(bytes)});
  writer_wakeup_.notify_all();
}

bool Coordinator::has_room_or_call(std::function<void()> resume) {
  MutexLock lock(mutex_);
  if (ingest_bytes_ < options_.ingest_bytes || stopping_) return true;
  resumes_.push_back(std::move(resume));
  return false;
}

// The writer -------------------------------------------------------------------------------------

void Coordinator::post_to_writer(std::function<void()> task) {
  MutexLock lock(mutex_);
  write_tasks_.push_back(std::move(task));
  writer_wakeup_.notify_all();
}

bool Coordinator::run_writer(bool wait) {
  std::deque<std::function<void()>> tasks;
  {
    MutexLock lock(mutex_);
    while (wait && !stopping_ && delivered_.empty() && write_tasks_.empty() && changed_.empty() &&
           roster_.empty() && after_journal_.empty()) {
      writer_wakeup_.wait(mutex_);
    }
    if (delivered_.empty() && write_tasks_.empty() && changed_.empty() && roster_.empty() &&
        after_journal_.empty()) {
      return false;
    }
    tasks.swap(write_tasks_);
  }
  journal_changes();
  for (const auto& task : tasks) task();
  commit_group();
  return true;
}

void Coordinator::journal_changes() {
  std::vector<std::pair<JobKey, JobRecord>> records;
  std::vector<std::pair<std::string, bool>> roster;
  std::vector<std::function<void()>> callbacks;
  {
    MutexLock lock(mutex_);
    for (const JobKey key : changed_) {
      if (const Job* job = scheduler_.find_job(key)) records.emplace_back(key, record(*job));
    }
    changed_.clear();
    roster.swap(roster_);
    callbacks.swap(after_journal_);
  }
  for (const auto& [key, record] : records) {
    // Blocks and units first: a job that is DONE in the journal has none.
    absl::Status status = record.state == static_cast<std::int32_t>(JobState::done)
                              ? store_.close_job(record.id)
                              : absl::OkStatus();
    if (status.ok()) status = store_.update_job(record);
    if (status.ok()) continue;
    options_.metrics->errors.journal.Increment();
    log(LogLevel::error, absl::StrCat("job ", record.id, ": ", status.ToString()));
    MutexLock lock(mutex_);
    unjournaled_.insert(key);
  }
  for (const auto& [worker_id, joined] : roster) {
    const absl::Status status =
        joined ? store_.add_worker(worker_id, worker_id) : store_.remove_worker(worker_id);
    if (!status.ok())
      log(LogLevel::error, absl::StrCat("worker ", worker_id, ": ", status.ToString()));
  }
  for (const auto& callback : callbacks) callback();
}

bool Coordinator::commit_group() {
  std::vector<Delivered> group;
  {
    MutexLock lock(mutex_);
    std::int64_t bytes = 0;
    std::size_t count = 0;
    while (count < delivered_.size() && count < kGroupUnits && bytes < kGroupBytes) {
      bytes += delivered_[count++].header.size_bytes;
    }
    const auto end = delivered_.begin() + static_cast<std::ptrdiff_t>(count);
    group.assign(std::make_move_iterator(delivered_.begin()), std::make_move_iterator(end));
    delivered_.erase(delivered_.begin(), end);
  }
  if (group.empty()) return false;
  CheckedGroup checked;
  check_group(group, checked);
  if (!checked.commits.empty()) {
    const Time started = options_.clock();
    const absl::Status status = store_.commit(checked.commits);
    options_.metrics->commit_seconds.Observe(seconds(options_.clock() - started));
    if (!status.ok()) {
      options_.metrics->errors.commit.Increment();
      commit_failed(checked, status);
      return true;
    }
  }
  apply_commit(checked);
  log(LogLevel::debug, absl::StrCat(checked.commits.size(), " units committed in one group"));
  return true;
}

void Coordinator::check_group(std::vector<Delivered>& group, CheckedGroup& checked) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  std::set<std::pair<std::string, Unit>> seen;
  for (Delivered& block : group) {
    const BlockHeader& header = block.header;
    Job* job = scheduler_.find_job(header.lease.job_id);
    if (job == nullptr || !scheduler_.wants(*job, header.lease, header.unit()) ||
        scheduler_.is_quarantined(block.worker_id)) {
      ingest_bytes_ -= weight(header);
      answer_obsolete(block.worker_id, header);
    } else if (handle_duplicate(*job, block.worker_id, header)) {
      ingest_bytes_ -= weight(header);
    } else if (!seen.insert({header.lease.job_id, header.unit()}).second) {
      checked.repeats.push_back(std::move(block));
    } else {
      Commit commit;
      commit.job_id = header.lease.job_id;
      commit.record.unit = header.unit();
      commit.record.sha256 = header.sha256;
      commit.record.worker_id = block.worker_id;
      commit.record.cpu_seconds = header.cpu_seconds;
      commit.record.size_bytes = header.size_bytes;
      if (scheduler_.wants_audit(*job, header.unit(), block.worker_id)) {
        commit.record.audit = AuditState::open;
      }
      commit.block = std::move(block.bytes);
      checked.commits.push_back(std::move(commit));
      checked.committed.push_back(std::move(block));
    }
  }
  apply_effects(deferred);
}

void Coordinator::commit_failed(const CheckedGroup& checked, const absl::Status& status) {
  log(LogLevel::error,
      absl::StrCat("commit of ", checked.commits.size(), " units: ", status.ToString()));
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  for (const auto* list : {&checked.committed, &checked.repeats}) {
    for (const Delivered& block : *list) {
      ingest_bytes_ -= weight(block.header);  // not acknowledged, so the worker sends it again
      Job* job = scheduler_.find_job(block.header.lease.job_id);
      if (job == nullptr || !absl::IsResourceExhausted(status)) continue;
      pause_for_room(*job, status);
    }
  }
  for (auto& resume : std::exchange(resumes_, {})) deferred.add(std::move(resume));
  apply_effects(deferred);
}

/// Pauses a job because the disk is full. Does nothing for an ended job.
void Coordinator::pause_for_room(Job& job, const absl::Status& status) {
  scheduler_
      .pause(job, absl::StrCat("store full: ", std::string(status.message())), options_.clock())
      .IgnoreError();
}

/// Call before Scheduler::commit(), which drops the unit's holders.
void Coordinator::count_committed(Job& job, const UnitRecord& record, std::int64_t samples) {
  FarmMetrics& metrics = *options_.metrics;
  metrics.units_committed.Increment();
  metrics.samples.Increment(static_cast<double>(samples));
  metrics.block_bytes.Increment(static_cast<double>(record.size_bytes));
  metrics.cpu_seconds.Increment(record.cpu_seconds);
  const std::optional<double> leased = turnaround_seconds(job, record);
  if (leased) metrics.unit_turnaround_seconds.Observe(*leased);
  const auto failures = job.unit_failures.find(record.unit);
  const std::int32_t retries =
      failures == job.unit_failures.end()
          ? 0
          : failures->second.losses + static_cast<std::int32_t>(failures->second.failures.size());
  deliveries_.add({.job = job.key,
                   .unit = record.unit,
                   .worker_id = record.worker_id,
                   .retry_count = retries,
                   .end_us = options_.wall_us(),
                   .cpu_seconds = record.cpu_seconds,
                   .lease_seconds = leased});
}

/// Returns the seconds since the unit was leased to its worker, if this process leased it.
std::optional<double> Coordinator::turnaround_seconds(Job& job, const UnitRecord& record) {
  const Worker* worker = scheduler_.find_worker(record.worker_id);
  const InFlight* in_flight = job.open_plan().find_in_flight(record.unit);
  if (worker == nullptr || in_flight == nullptr) return std::nullopt;
  for (const Holder& holder : in_flight->holders) {
    if (holder.worker != worker->key || !holder.leased) continue;
    return seconds(options_.clock() - *holder.leased);
  }
  return std::nullopt;
}

void Coordinator::apply_commit(CheckedGroup& checked) {
  DeferredCalls deferred;
  MutexLock lock(mutex_);
  for (std::size_t i = 0; i < checked.committed.size(); ++i) {
    Delivered& block = checked.committed[i];
    const UnitRecord& record = checked.commits[i].record;
    ingest_bytes_ -= weight(block.header);
    Job* job = scheduler_.find_job(checked.commits[i].job_id);
    if (job == nullptr) continue;
    open_block_index(*job).add(record, job->wall_seconds(options_.clock()));
    JobFilm& film = job_film(*job);
    const contract::PixelRect rect = tile_grid(*job).rect(record.unit.tile);
    const std::int64_t samples =
        std::int64_t{rect.width} * rect.height * block.header.lease.sample_count;
    film.committed_samples += samples;
    count_committed(*job, record, samples);
    job->counters.cost += block.header.cost;
    scheduler_.commit(*job, record.unit, record.worker_id, record.cpu_seconds);
    if (scheduler_.is_quarantined(record.worker_id)) {  // found faulty in the meantime
      job_film(*job).finishing.insert(record.unit.frame);
      write_tasks_.emplace_back([this, key = FrameKey{job->spec->id, record.unit.frame},
                                 worker = record.worker_id] { redo_units_by_worker(key, worker); });
    } else if (record.audit == AuditState::open) {
      scheduler_.open_audit(*job, record.unit, record.worker_id, record.sha256);
    }
    acknowledge(block.worker_id, checked.commits[i].job_id, record.unit, AckStatus::committed, "");
    FilmUpdate update{checked.commits[i].job_id, record.unit, std::nullopt, 0};
    // If the film thread lags behind, it reads the block back later; commits do not wait.
    if (ingest_bytes_ < options_.ingest_bytes / 2) {
      update.block = std::move(block.block);
      update.bytes = block.header.size_bytes;
      ingest_bytes_ += update.bytes;
    }
    enqueue_film([this, shared = std::make_shared<FilmUpdate>(std::move(update))] {
      merge(std::move(*shared));
    });
    finish_if_complete(*job, record.unit.frame);
  }
  for (Delivered& block : checked.repeats) {
    ingest_bytes_ -= weight(block.header);
    Job* job = scheduler_.find_job(block.header.lease.job_id);
    if (job == nullptr || !handle_duplicate(*job, block.worker_id, block.header)) {
      answer_obsolete(block.worker_id, block.header);
    }
  }
  for (auto& resume : std::exchange(resumes_, {})) deferred.add(std::move(resume));
  apply_effects(deferred);
}

/// Returns whether all units of a frame are committed and no audit is open.
bool Coordinator::is_ready(const Job& job, std::int32_t frame) const {
  return job.plan->is_complete(frame) && !scheduler_.has_audits(job, frame);
}

void Coordinator::finish_if_complete(Job& job, std::int32_t frame) {
  if (has_ended(job.state) || !is_ready(job, frame) || job.plan->is_finished(frame)) return;
  if (!job_film(job).finishing.insert(frame).second) return;
  enqueue_film([this, key = FrameKey{job.spec->id, frame}] { finish_frame(key); });
}

}  // namespace tessera::server
