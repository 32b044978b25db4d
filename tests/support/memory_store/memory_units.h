#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/memory_store/memory_accounts.h"
#include "tests/support/memory_store/memory_rows.h"

namespace tessera::server {

/// Units and their blocks in memory.
class MemoryUnits final : public UnitStore {
 public:
  MemoryUnits(MemoryRows& rows, MemoryUsage& usage) : rows_(rows), usage_(usage) {}

  /// Makes reading this unit's block fail with DataLoss until the unit is committed again.
  void damage(const contract::Unit& unit) {
    const std::lock_guard lock(rows_.mutex);
    damaged_.insert(unit);
  }
  /// Makes reading the units of this job fail with `status`.
  void fail_reads_of(const std::string& job_id, const absl::Status& status) {
    const std::lock_guard lock(rows_.mutex);
    unreadable_[job_id] = status;
  }
  /// Number of committed groups.
  int group_count() const { return group_count_; }
  /// Sets the hour in which commits are charged.
  void set_hour(std::int64_t hour) { hour_ = hour; }

  absl::Status commit(std::vector<Commit>& group) override {
    const std::lock_guard lock(rows_.mutex);
    if (!rows_.commit_fault.ok()) return rows_.commit_fault;
    const auto fault = rows_.job_faults.find(group.front().job_id);
    if (fault != rows_.job_faults.end()) return fault->second;
    ++group_count_;
    for (Commit& commit : group) {
      commit.record.segment = 0;
      commit.record.offset = next_offset_++;
      commit.record.stored_bytes = static_cast<std::int64_t>(commit.block.size());
      const bool is_new = rows_.units[commit.job_id]
                              .emplace(commit.record.unit, std::pair(commit.record, commit.block))
                              .second;
      if (!is_new) return absl::AlreadyExistsError("unit");
      charge(commit);
      damaged_.erase(commit.record.unit);
    }
    return absl::OkStatus();
  }
  absl::Status for_each(const std::string& job_id,
                        const std::function<void(const UnitRecord&)>& visit) const override {
    const std::lock_guard lock(rows_.mutex);
    if (const auto fault = unreadable_.find(job_id); fault != unreadable_.end()) {
      return fault->second;
    }
    const auto units = rows_.units.find(job_id);
    if (units == rows_.units.end()) return absl::OkStatus();
    for (const auto& [unit, entry] : units->second) visit(entry.first);
    return absl::OkStatus();
  }
  absl::StatusOr<std::string> read_block(const std::string& job_id,
                                         const UnitRecord& record) const override {
    const std::lock_guard lock(rows_.mutex);
    if (rows_.released.count(job_id) > 0) return absl::NotFoundError("released");
    if (damaged_.count(record.unit) > 0) return absl::DataLossError("damaged");
    return rows_.units.at(job_id).at(record.unit).second;
  }
  absl::Status drop(const std::string& job_id, const std::vector<contract::Unit>& units) override {
    const std::lock_guard lock(rows_.mutex);
    for (const contract::Unit& unit : units) {
      const auto found = rows_.units[job_id].find(unit);
      if (found == rows_.units[job_id].end()) continue;
      usage_.refund(job_id, found->second.first.cpu_seconds);
      rows_.units[job_id].erase(found);
    }
    return absl::OkStatus();
  }

  absl::Status set_audits(const std::string& job_id, const std::vector<contract::Unit>& units,
                          AuditState state) override {
    const std::lock_guard lock(rows_.mutex);
    for (const contract::Unit& unit : units) {
      const auto found = rows_.units[job_id].find(unit);
      if (found != rows_.units[job_id].end()) found->second.first.audit = state;
    }
    return absl::OkStatus();
  }

  absl::Status close_job(const std::string& job_id) override {
    const std::lock_guard lock(rows_.mutex);
    rows_.released.insert(job_id);
    for (const auto& [unit, entry] : rows_.units[job_id]) {
      const UnitRecord& record = entry.first;
      UnitTotals& totals = rows_.totals[job_id][record.worker_id];
      totals.worker_id = record.worker_id;
      ++totals.units;
      totals.cpu_seconds += record.cpu_seconds;
      if (record.audit == AuditState::ended) ++totals.audited;
    }
    rows_.units.erase(job_id);
    return absl::OkStatus();
  }
  absl::StatusOr<std::vector<UnitTotals>> totals(const std::string& job_id) const override {
    const std::lock_guard lock(rows_.mutex);
    std::vector<UnitTotals> totals;
    const auto found = rows_.totals.find(job_id);
    if (found == rows_.totals.end()) return totals;
    for (const auto& [worker, sum] : found->second) totals.push_back(sum);
    return totals;
  }

 private:
  void charge(const Commit& commit) {
    UsageSum use{"", "", 0, commit.job_id, "", 1, commit.record.cpu_seconds};
    for (const auto& [sequence, job] : rows_.jobs) {
      if (job.id != commit.job_id) continue;
      use.owner = job.owner;
      use.project = job.project;
      use.job = sequence;
      use.job_name = job.name;
    }
    usage_.add(hour_, use);
  }

  MemoryRows& rows_;
  MemoryUsage& usage_;
  std::map<std::string, absl::Status> unreadable_;  // by job
  std::set<contract::Unit> damaged_;
  int group_count_ = 0;
  std::int64_t next_offset_ = 0, hour_ = 0;
};

}  // namespace tessera::server
