#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/store/store.h"
#include "tests/support/disk/memory_accounts.h"
#include "tests/support/disk/memory_assets.h"

namespace tessera::server {

/// A store in memory with injected failures: rows and blocks outlive the coordinator that wrote
/// them; images are files in `folder`.
class MemoryStore final : public Store, public WorkerStore {
 public:
  explicit MemoryStore(const std::string& folder) : folder_(folder), assets_(folder) {}

  /// Makes commit(), finish_frame() and changes of a job's row fail with `status` from now on; OK
  /// ends it.
  void fail_commits_with(absl::Status status) {
    const std::lock_guard lock(mutex_);
    commit_fault_ = std::move(status);
  }
  /// Makes write_together() fail, with nothing written, from now on; OK ends it.
  void fail_transactions_with(absl::Status status) {
    const std::lock_guard lock(mutex_);
    transaction_fault_ = std::move(status);
  }
  /// Number of calls of write_together().
  int transaction_count() const { return transaction_count_; }
  /// Makes reading this unit's block fail with DataLoss until the unit is committed again.
  void damage(const contract::Unit& unit) {
    const std::lock_guard lock(mutex_);
    damaged_.insert(unit);
  }
  /// Number of committed groups.
  int group_count() const { return group_count_; }
  void reboot() { ++boot_count_; }
  void set_used_bytes(std::int64_t bytes) { used_bytes_ = bytes; }
  void set_free_bytes(std::int64_t bytes) { free_bytes_ = bytes; }
  /// Makes commits of this job fail with `status`.
  void fail_commits_of(const std::string& job_id, absl::Status status) {
    const std::lock_guard lock(mutex_);
    job_faults_[job_id] = std::move(status);
  }

  const std::string& id() const override { return id_; }
  const std::string& key() const override { return key_; }
  std::int64_t boot_count() const override { return boot_count_; }

  absl::Status write_together(const std::function<void()>& body) override {
    absl::Status fault;
    {
      const std::lock_guard lock(mutex_);
      ++transaction_count_;
      fault = transaction_fault_;
    }
    if (fault.ok()) body();
    return fault;
  }
  absl::Status add_job(JobRecord& job) override {
    const std::lock_guard lock(mutex_);
    if (!used_ids_.insert(job.id).second) return absl::AlreadyExistsError("id");
    job.sequence = ++last_sequence_;
    jobs_[job.sequence] = job;
    return absl::OkStatus();
  }
  absl::Status update_job(const JobRecord& job) override {
    const std::lock_guard lock(mutex_);
    if (!commit_fault_.ok()) return commit_fault_;
    jobs_.at(job.sequence) = job;
    return absl::OkStatus();
  }
  absl::Status remove_job(const std::string& job_id) override {
    const std::lock_guard lock(mutex_);
    if (!commit_fault_.ok()) return commit_fault_;
    for (const auto& [sequence, job] : jobs_) {
      if (job.id == job_id) removed_[job_id] = job.state;
    }
    std::erase_if(jobs_, [&](const auto& entry) { return entry.second.id == job_id; });
    units_.erase(job_id);
    totals_.erase(job_id);
    frames_.erase(job_id);
    return absl::OkStatus();
  }
  absl::StatusOr<std::vector<JobRecord>> jobs() const override {
    const std::lock_guard lock(mutex_);
    std::vector<JobRecord> jobs;
    for (const auto& [sequence, job] : jobs_) jobs.push_back(job);
    return jobs;
  }

  absl::StatusOr<std::optional<std::int32_t>> removed_state(
      const std::string& job_id) const override {
    const std::lock_guard lock(mutex_);
    const auto found = removed_.find(job_id);
    if (found == removed_.end()) return std::nullopt;
    return found->second;
  }
  EventStore& events() override { return events_; }
  const EventStore& events() const override { return events_; }
  const UsageStore& usage() const override { return usage_; }
  /// Sets the number of events that are kept.
  void keep_events(std::size_t count) { events_.keep(count); }
  /// Sets the hour in which commits are charged.
  void set_hour(std::int64_t hour) { hour_ = hour; }
  absl::Status save_settings(SettingKind kind, const Settings& settings) override {
    const std::lock_guard lock(mutex_);
    if (!commit_fault_.ok()) return commit_fault_;
    settings_[kind] = settings;
    return absl::OkStatus();
  }
  absl::StatusOr<Settings> settings(SettingKind kind) const override {
    const std::lock_guard lock(mutex_);
    const auto found = settings_.find(kind);
    return found == settings_.end() ? Settings{} : found->second;
  }

  absl::Status commit(std::vector<Commit>& group) override {
    const std::lock_guard lock(mutex_);
    if (!commit_fault_.ok()) return commit_fault_;
    const auto fault = job_faults_.find(group.front().job_id);
    if (fault != job_faults_.end()) return fault->second;
    ++group_count_;
    for (Commit& commit : group) {
      commit.record.segment = 0;
      commit.record.offset = next_offset_++;
      commit.record.stored_bytes = static_cast<std::int64_t>(commit.block.size());
      const bool is_new = units_[commit.job_id]
                              .emplace(commit.record.unit, std::pair(commit.record, commit.block))
                              .second;
      if (!is_new) return absl::AlreadyExistsError("unit");
      charge(commit);
      damaged_.erase(commit.record.unit);
    }
    return absl::OkStatus();
  }
  absl::Status for_each_unit(const std::string& job_id,
                             const std::function<void(const UnitRecord&)>& visit) const override {
    const std::lock_guard lock(mutex_);
    const auto units = units_.find(job_id);
    if (units == units_.end()) return absl::OkStatus();
    for (const auto& [unit, entry] : units->second) visit(entry.first);
    return absl::OkStatus();
  }
  absl::StatusOr<std::string> read_block(const std::string& job_id,
                                         const UnitRecord& record) const override {
    const std::lock_guard lock(mutex_);
    if (released_.count(job_id) > 0) return absl::NotFoundError("released");
    if (damaged_.count(record.unit) > 0) return absl::DataLossError("damaged");
    return units_.at(job_id).at(record.unit).second;
  }
  absl::Status rewrite_job(const JobRecord& job,
                           const std::vector<contract::Unit>& dropped) override {
    const std::lock_guard lock(mutex_);
    if (!commit_fault_.ok()) return commit_fault_;
    for (const contract::Unit& unit : dropped) units_[job.id].erase(unit);
    jobs_.at(job.sequence) = job;
    return absl::OkStatus();
  }
  absl::Status drop_units(const std::string& job_id,
                          const std::vector<contract::Unit>& units) override {
    const std::lock_guard lock(mutex_);
    for (const contract::Unit& unit : units) {
      const auto found = units_[job_id].find(unit);
      if (found == units_[job_id].end()) continue;
      usage_.refund(job_id, found->second.first.cpu_seconds);
      units_[job_id].erase(found);
    }
    return absl::OkStatus();
  }

  absl::Status end_audits(const std::string& job_id,
                          const std::vector<contract::Unit>& units) override {
    const std::lock_guard lock(mutex_);
    for (const contract::Unit& unit : units) {
      const auto found = units_[job_id].find(unit);
      if (found != units_[job_id].end()) found->second.first.audit = AuditState::ended;
    }
    return absl::OkStatus();
  }

  absl::StatusOr<std::string> output_folder(const std::string& job_id) override {
    const std::string folder = folder_ + "/" + job_id;
    std::filesystem::create_directories(folder);
    return folder;
  }
  absl::Status finish_frame(const std::string& job_id, const FrameRecord& frame) override {
    const std::lock_guard lock(mutex_);
    if (!commit_fault_.ok()) return commit_fault_;
    frames_[job_id][frame.frame] = frame;
    return absl::OkStatus();
  }
  std::int64_t max_row_image_bytes() const override { return 0; }
  absl::Status finish_small_frame(const std::string& job_id, const FrameRecord& frame,
                                  const std::string&) override {
    return finish_frame(job_id, frame);
  }
  absl::Status update_statistics(const std::string& job_id, std::int32_t frame,
                                 const std::string& statistics_json) override {
    const std::lock_guard lock(mutex_);
    if (!commit_fault_.ok()) return commit_fault_;
    frames_.at(job_id).at(frame).statistics_json = statistics_json;
    return absl::OkStatus();
  }
  absl::StatusOr<std::optional<std::string>> row_image(const std::string&,
                                                       std::int32_t) const override {
    return std::nullopt;
  }
  absl::StatusOr<std::vector<FrameRecord>> frames(const std::string& job_id) const override {
    const std::lock_guard lock(mutex_);
    std::vector<FrameRecord> frames;
    const auto found = frames_.find(job_id);
    if (found == frames_.end()) return frames;
    for (const auto& [number, frame] : found->second) frames.push_back(frame);
    return frames;
  }
  absl::Status close_job(const std::string& job_id) override {
    const std::lock_guard lock(mutex_);
    released_.insert(job_id);
    for (const auto& [unit, entry] : units_[job_id]) {
      const UnitRecord& record = entry.first;
      UnitTotals& totals = totals_[job_id][record.worker_id];
      totals.worker_id = record.worker_id;
      ++totals.units;
      totals.cpu_seconds += record.cpu_seconds;
      if (record.audit == AuditState::ended) ++totals.audited;
    }
    units_.erase(job_id);
    return absl::OkStatus();
  }
  absl::StatusOr<std::vector<UnitTotals>> totals(const std::string& job_id) const override {
    const std::lock_guard lock(mutex_);
    std::vector<UnitTotals> totals;
    const auto found = totals_.find(job_id);
    if (found == totals_.end()) return totals;
    for (const auto& [worker, sum] : found->second) totals.push_back(sum);
    return totals;
  }

  MemoryAssets& assets() override { return assets_; }
  const MemoryAssets& assets() const override { return assets_; }

  MemoryStore& workers() override { return *this; }
  const MemoryStore& workers() const override { return *this; }

  absl::Status add_worker(const std::string& worker_id, const std::string&) override {
    const std::lock_guard lock(mutex_);
    roster_.insert(worker_id);
    return absl::OkStatus();
  }
  absl::Status remove_worker(const std::string& worker_id) override {
    const std::lock_guard lock(mutex_);
    roster_.erase(worker_id);
    return absl::OkStatus();
  }
  absl::StatusOr<std::vector<std::string>> roster() const override {
    const std::lock_guard lock(mutex_);
    return std::vector<std::string>(roster_.begin(), roster_.end());
  }
  absl::Status ban_worker(const std::string& worker_id) override {
    const std::lock_guard lock(mutex_);
    banned_.insert(worker_id);
    return absl::OkStatus();
  }
  absl::Status allow_worker(const std::string& worker_id) override {
    const std::lock_guard lock(mutex_);
    banned_.erase(worker_id);
    return absl::OkStatus();
  }
  absl::StatusOr<std::vector<std::string>> banned_workers() const override {
    const std::lock_guard lock(mutex_);
    return std::vector<std::string>(banned_.begin(), banned_.end());
  }
  absl::Status record_join(const Join& join, std::int64_t max_joins) override {
    const std::lock_guard lock(mutex_);
    std::set<std::string>& joined = joins_[join.token_id];
    const bool is_full = max_joins > 0 && static_cast<std::int64_t>(joined.size()) >= max_joins;
    if (is_full && joined.count(join.worker_id) == 0) return absl::PermissionDeniedError("used up");
    joined.insert(join.worker_id);
    return absl::OkStatus();
  }
  absl::Status remove_stale_joins(const std::vector<std::string>&, std::int64_t) override {
    return absl::OkStatus();
  }
  std::int64_t free_bytes() const override { return free_bytes_; }
  std::int64_t used_bytes() const override { return used_bytes_; }

 private:
  void charge(const Commit& commit) {
    UsageSum use{"", "", 0, commit.job_id, "", 1, commit.record.cpu_seconds};
    for (const auto& [sequence, job] : jobs_) {
      if (job.id != commit.job_id) continue;
      use.owner = job.owner;
      use.project = job.project;
      use.job = sequence;
      use.job_name = job.name;
    }
    usage_.add(hour_, use);
  }

  const std::string folder_;
  MemoryAssets assets_;
  const std::string id_ = "0123456789abcdef0123456789abcdef";
  const std::string key_ = "thirty-two bytes of a secret key";
  std::int64_t boot_count_ = 1, used_bytes_ = 0;
  std::int64_t free_bytes_ = std::int64_t{1} << 40;
  std::map<std::string, absl::Status> job_faults_;
  mutable std::mutex mutex_;
  absl::Status commit_fault_, transaction_fault_;
  int group_count_ = 0, transaction_count_ = 0;
  std::int64_t last_sequence_ = 0, next_offset_ = 0;
  std::set<std::string> used_ids_, released_, roster_, banned_;
  std::map<std::string, std::set<std::string>> joins_;  // by token
  std::map<std::int64_t, JobRecord> jobs_;
  std::map<std::string, std::map<contract::Unit, std::pair<UnitRecord, std::string>>> units_;
  std::map<std::string, std::map<std::string, UnitTotals>> totals_;  // by job, worker
  std::map<std::string, std::map<std::int32_t, FrameRecord>> frames_;
  std::map<std::string, std::int32_t> removed_;  // states
  std::map<SettingKind, Settings> settings_;
  MemoryEvents events_;
  MemoryUsage usage_;
  std::int64_t hour_ = 0;
  std::set<contract::Unit> damaged_;
};

}  // namespace tessera::server
