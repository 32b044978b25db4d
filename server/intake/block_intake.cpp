#include "server/intake/block_intake.h"

#include <cstddef>
#include <iterator>
#include <memory>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {

using contract::Unit;

namespace {

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

/// Returns the seconds since the unit was leased to its worker, if this process leased it.
std::optional<double> turnaround_seconds(FarmChange& change, Job& job, const UnitRecord& record) {
  const Worker* worker = change.scheduler().workers().find(record.worker_id);
  const InFlight* in_flight = job.open_plan().find_in_flight(record.unit);
  if (worker == nullptr || in_flight == nullptr) return std::nullopt;
  for (const Holder& holder : in_flight->holders) {
    if (holder.worker != worker->key || !holder.leased) continue;
    return seconds(change.now() - *holder.leased);
  }
  return std::nullopt;
}

}  // namespace

// Verdicts ---------------------------------------------------------------------------------------

absl::Status BlockIntake::check_delivery(const std::string& worker_id,
                                         const std::string& certificate) {
  FarmChange change(farm_);
  const Worker* worker = change.scheduler().workers().find(worker_id);
  if (worker == nullptr || !worker->connected || worker->certificate != certificate) {
    return absl::FailedPreconditionError("this worker has no open Work stream; open one first");
  }
  change.scheduler().connections().record_contact(worker->key, change.now());
  return absl::OkStatus();
}

void BlockIntake::acknowledge(FarmChange& change, const std::string& worker_id,
                              const BlockHeader& header, AckStatus status,
                              const std::string& reason) {
  farm_.metrics().acknowledgement(status).Increment();
  const Worker* worker = change.scheduler().workers().find(worker_id);
  if (worker == nullptr) return;
  change.scheduler().connections().acknowledge(
      worker->key, {{header.lease.job_id, header.unit()}, status, reason});
}

void BlockIntake::reject(FarmChange& change, const std::string& worker_id,
                         const BlockHeader& header, const std::string& reason) {
  Worker* worker = change.scheduler().workers().find(worker_id);
  if (worker == nullptr) return;
  farm_.metrics().errors.block_rejected.Increment();
  change.log(LogLevel::warn, absl::StrCat("worker ", worker_id, ": block of job ",
                                          header.lease.job_id, " rejected: ", reason));
  acknowledge(change, worker_id, header, AckStatus::rejected, reason);
  change.scheduler().failures().fail_unit(worker->key, header.lease, header.tile,
                                          {worker_id, absl::StrCat("block rejected: ", reason), ""},
                                          absl::StatusCode::kDataLoss, change.now());
}

void BlockIntake::answer_obsolete(FarmChange& change, const std::string& worker_id,
                                  const BlockHeader& header) {
  acknowledge(change, worker_id, header, AckStatus::obsolete, "");
  Job* job = change.find_job(header.lease.job_id);
  if (job == nullptr) return;
  job->counters.wasted_cpu_seconds += header.cpu_seconds;
  if (job->plan) change.scheduler().results().release_duplicate(*job, header.unit(), worker_id);
}

/// Acknowledges a unit that is already committed; returns false if it is not.
bool BlockIntake::answer_duplicate(FarmChange& change, Job& job, const std::string& worker_id,
                                   const BlockHeader& header) {
  const BlockIndex& block_index = change.film(job).open_block_index(job);
  const BlockIndex::BlockLocation* found = block_index.find(header.unit());
  if (found == nullptr) return false;
  const BlockIndex::BlockLocation location = *found;
  const bool is_answer = change.scheduler().audits().answer_audit(
      job, header.unit(), header.lease, {worker_id, header.sha256},
      {block_index.worker(location), location.sha256}, change.now());
  if (!is_answer) ++job.counters.duplicated;
  deliveries_.add({.job = job.key,
                   .unit = header.unit(),
                   .worker_id = worker_id,
                   .outcome = is_answer ? DeliveryOutcome::audit : DeliveryOutcome::duplicate,
                   .end_us = farm_.options().wall_us(),
                   .cpu_seconds = header.cpu_seconds});
  job.counters.wasted_cpu_seconds += header.cpu_seconds;
  change.scheduler().results().release_duplicate(job, header.unit(), worker_id);
  if (location.sha256 == header.sha256) {
    acknowledge(change, worker_id, header, AckStatus::duplicate, "");
  } else {
    ++job.counters.mismatched;
    farm_.metrics().results_mismatched.Increment();
    answer_mismatch(worker_id, header);
  }
  return true;
}

/// Rejects a result that differs from the committed one, once it is durable that the unit is
/// audited: without this, a server that is killed now would never find out which one is wrong.
void BlockIntake::answer_mismatch(const std::string& worker_id, const BlockHeader& header) {
  const auto mark = [this, header] {
    if (farm_.options().policy.audit_fraction == 0) return absl::OkStatus();
    return store_.units().set_audits(header.lease.job_id, {header.unit()}, AuditState::open);
  };
  pipeline_.post_write(mark, [this, worker_id, header](const absl::Status& status) {
    if (!status.ok()) return;  // the worker sends it again
    FarmChange change(farm_);
    acknowledge(change, worker_id, header, AckStatus::rejected,
                "result differs from the committed one");
  });
}

// Delivery ---------------------------------------------------------------------------------------

std::optional<Admission> BlockIntake::admit(const std::string& worker_id,
                                            const BlockHeader& header) {
  const bool is_sealed = is_seal_valid(header.lease, worker_id, store_.key());
  FarmChange change(farm_);
  if (!is_sealed) {
    acknowledge(change, worker_id, header, AckStatus::rejected,
                "invalid seal: this store did not grant the lease to this worker");
    return std::nullopt;
  }
  return check_header(change, worker_id, header);
}

std::optional<Admission> BlockIntake::check_header(FarmChange& change, const std::string& worker_id,
                                                   const BlockHeader& header) {
  Job* job = change.find_job(header.lease.job_id);
  if (job != nullptr && !has_ended(job->state)) job->open_plan();
  if (job == nullptr || !change.scheduler().results().wants(*job, header.lease, header.unit())) {
    answer_obsolete(change, worker_id, header);
    return std::nullopt;
  }
  const contract::PixelRect rect = change.film(*job).open_grid(*job).rect(header.tile);
  const Admission admission{
      {rect.width, rect.height, job->spec->settings.aovs, header.lease.pass == 0},
      header.lease.sample_count};
  const absl::Status size = check_size(header, admission.shape);
  if (size.ok()) return admission;
  reject(change, worker_id, header, std::string(size.message()));
  return std::nullopt;
}

void BlockIntake::deliver(const std::string& worker_id, const BlockHeader& header,
                          const Admission& admission, std::string bytes) {
  std::string fault;
  absl::StatusOr<contract::FilmBlock> block = absl::InternalError("not decoded");
  if (contract::sha256(bytes) != header.sha256) {
    fault = "its bytes do not match sha256";
  } else {
    block = contract::decode(bytes, admission.shape, admission.sample_count);
    if (!block.ok()) fault = std::string(block.status().message());
  }
  if (!fault.empty()) {
    FarmChange change(farm_);
    return reject(change, worker_id, header, fault);
  }
  budget_.take(weight(header));
  const MutexLock lock(mutex_);
  delivered_.push_back({worker_id, header, *std::move(block), std::move(bytes)});
  if (!std::exchange(is_commit_posted_, true)) post_commit();
}

// Commit, on the writer thread -------------------------------------------------------------------

void BlockIntake::post_commit() {
  const auto group = std::make_shared<Group>();
  pipeline_.post_write(
      [this, group] {
        commit_group(*group);
        return absl::OkStatus();  // each job has its own status
      },
      [this, group](const absl::Status& status) { answer_group(*group, status); });
}

/// Returns the blocks to commit next, at most so many that acknowledgements do not come late.
std::vector<BlockIntake::Delivered> BlockIntake::next_blocks() {
  constexpr std::size_t kGroupUnits = 1024;
  constexpr std::int64_t kGroupBytes = std::int64_t{64} << 20;
  const MutexLock lock(mutex_);
  std::int64_t bytes = 0;
  std::size_t count = 0;
  while (count < delivered_.size() && count < kGroupUnits && bytes < kGroupBytes) {
    bytes += delivered_[count++].header.size_bytes;
  }
  const auto end = delivered_.begin() + static_cast<std::ptrdiff_t>(count);
  std::vector<Delivered> blocks(std::make_move_iterator(delivered_.begin()),
                                std::make_move_iterator(end));
  delivered_.erase(delivered_.begin(), end);
  is_commit_posted_ = !delivered_.empty();
  if (is_commit_posted_) post_commit();
  return blocks;
}

/// Commits the next blocks as a part of the round's transaction. A job whose blocks cannot be
/// written leaves the others.
void BlockIntake::commit_group(Group& group) {
  group.started = farm_.now();
  check_group(group);
  for (auto& [job_id, job] : group.jobs) job.status = store_.units().commit(job.commits);
}

void BlockIntake::check_group(Group& group) {
  std::vector<Delivered> blocks = next_blocks();
  group.is_checked = true;
  FarmChange change(farm_);
  const MutexLock lock(mutex_);
  for (Delivered& block : blocks) {
    const BlockHeader& header = block.header;
    group.bytes += weight(header);
    Job* job = change.find_job(header.lease.job_id);
    if (job == nullptr || !change.scheduler().results().wants(*job, header.lease, header.unit()) ||
        change.scheduler().quarantine().is_quarantined(block.worker_id)) {
      answer_obsolete(change, block.worker_id, header);
    } else if (answer_duplicate(change, *job, block.worker_id, header)) {
      continue;
    } else if (!committing_.insert({header.lease.job_id, header.unit()}).second) {
      group.repeats.push_back(std::move(block));
    } else {
      Commit commit;
      commit.job_id = header.lease.job_id;
      commit.record.unit = header.unit();
      commit.record.sha256 = header.sha256;
      commit.record.worker_id = block.worker_id;
      commit.record.cpu_seconds = header.cpu_seconds;
      commit.record.size_bytes = header.size_bytes;
      if (change.scheduler().audits().wants_audit(*job, header.unit(), block.worker_id,
                                                  change.now())) {
        commit.record.audit = AuditState::open;
      } else {
        warn_of_shared_certificate(change, *job, block.worker_id);
      }
      commit.block = std::move(block.bytes);
      JobGroup& of_job = group.jobs[commit.job_id];
      of_job.commits.push_back(std::move(commit));
      of_job.blocks.push_back(std::move(block));
    }
  }
}

void BlockIntake::warn_of_shared_certificate(FarmChange& change, Job& job,
                                             const std::string& worker_id) {
  const std::vector<std::string> sharers =
      change.scheduler().audits().note_unaudited(job, worker_id, change.now());
  if (sharers.empty()) return;
  const std::string& certificate = change.scheduler().workers().find(worker_id)->certificate;
  change.log(LogLevel::warn,
             absl::StrCat("job ", job.spec->id, ": its units are not audited, because its ",
                          sharers.size(), " workers share the certificate ", certificate,
                          " and count as one; give each worker a certificate of its own"));
}

/// Acknowledges what is durable now. `status`: of the round's transaction.
void BlockIntake::answer_group(Group& group, const absl::Status& status) {
  if (!group.is_checked) check_group(group);  // the transaction did not begin
  farm_.metrics().commit_seconds.Observe(seconds(farm_.now() - group.started));
  budget_.give_back(group.bytes);  // takes again what waits for a film thread
  FarmChange change(farm_);
  forget_committing(group);
  for (auto& [job_id, of_job] : group.jobs) {
    if (of_job.status.ok()) of_job.status = status;
    if (!of_job.status.ok()) {
      note_failed(change, job_id, of_job);
      continue;
    }
    change.log(LogLevel::debug, absl::StrCat("job ", job_id, ": ", of_job.commits.size(),
                                             " units committed in one group"));
    Job* job = change.find_job(job_id);
    for (std::size_t i = 0; job != nullptr && i < of_job.blocks.size(); ++i) {
      note_committed(change, *job, of_job.commits[i].record, of_job.blocks[i]);
    }
  }
  for (const Delivered& block : group.repeats) answer_repeat(change, block);
}

void BlockIntake::forget_committing(const Group& group) {
  const MutexLock lock(mutex_);
  for (const auto& [job_id, of_job] : group.jobs) {
    for (const Commit& commit : of_job.commits) committing_.erase({job_id, commit.record.unit});
  }
}

/// Acknowledges a block that came while another one of its unit was being committed.
void BlockIntake::answer_repeat(FarmChange& change, const Delivered& block) {
  const BlockHeader& header = block.header;
  Job* job = change.find_job(header.lease.job_id);
  if (job != nullptr && answer_duplicate(change, *job, block.worker_id, header)) return;
  // If the other one could not be written, the worker sends this one again.
  if (job != nullptr && change.scheduler().results().wants(*job, header.lease, header.unit()))
    return;
  answer_obsolete(change, block.worker_id, header);
}

/// Blocks that could not be committed are not acknowledged, so the workers send them again.
void BlockIntake::note_failed(FarmChange& change, const std::string& job_id,
                              const JobGroup& group) {
  farm_.metrics().errors.commit.Increment();
  change.log(LogLevel::error, absl::StrCat("job ", job_id, ": commit of ", group.commits.size(),
                                           " units: ", group.status.ToString()));
  Job* job = change.find_job(job_id);
  if (job != nullptr && absl::IsResourceExhausted(group.status)) {
    change.pause_for_room(*job, group.status);
  }
}

/// Notes in one section what a durable unit changes: its job's plan and index, its audit, its
/// acknowledgement and its frame. In two, a frame could be finished without its last unit.
void BlockIntake::note_committed(FarmChange& change, Job& job, const UnitRecord& record,
                                 Delivered& block) {
  Scheduler& scheduler = change.scheduler();
  JobFilm& film = change.film(job);
  film.open_block_index(job).add(record, job.wall_seconds(change.now()));
  const std::int64_t samples = film.unit_samples(job, record.unit);
  film.committed_samples += samples;
  film.block_bytes += record.stored_bytes;
  if (has_ended(job.state)) change.note_kept(job);
  count_committed(change, job, record, samples);
  job.counters.cost += block.header.cost;
  scheduler.results().commit(job, record.unit, record.worker_id, record.cpu_seconds);
  budgets_.charge(change, job, record.cpu_seconds);
  if (scheduler.quarantine().is_quarantined(record.worker_id)) {  // found faulty in the meantime
    audits_.note_late_unit(change, job, record.unit.frame, record.worker_id);
  } else if (record.audit == AuditState::open) {
    scheduler.audits().open_audit(job, record.unit, record.worker_id, record.sha256);
  }
  acknowledge(change, block.worker_id, block.header, AckStatus::committed, "");
  FilmUpdate update{job.spec->id, record.unit, std::nullopt, film.revision, nullptr};
  // If the film threads lag behind, they read the block back later; commits do not wait.
  if (budget_.used_bytes() < budget_.limit_bytes() / 2) {
    update.block = std::move(block.block);
    update.memory = budget_.hold(block.header.size_bytes);
  }
  finisher_.merge(std::move(update));
  finisher_.finish_if_complete(change, job, record.unit.frame);
}

/// Call before Scheduler::commit(), which drops the unit's holders.
void BlockIntake::count_committed(FarmChange& change, Job& job, const UnitRecord& record,
                                  std::int64_t samples) {
  FarmMetrics& metrics = farm_.metrics();
  metrics.units_committed.Increment();
  metrics.samples.Increment(static_cast<double>(samples));
  metrics.block_bytes.Increment(static_cast<double>(record.size_bytes));
  metrics.cpu_seconds.Increment(record.cpu_seconds);
  const std::optional<double> leased = turnaround_seconds(change, job, record);
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
                   .end_us = farm_.options().wall_us(),
                   .cpu_seconds = record.cpu_seconds,
                   .lease_seconds = leased});
}

}  // namespace tessera::server
