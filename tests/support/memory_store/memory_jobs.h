#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tests/support/memory_store/memory_rows.h"

namespace tessera::server {

/// Jobs in memory.
class MemoryJobs final : public JobStore {
 public:
  explicit MemoryJobs(MemoryRows& rows) : rows_(rows) {}

  absl::Status add(JobRecord& job) override {
    const std::lock_guard lock(rows_.mutex);
    if (!rows_.used_ids.insert(job.id).second) return absl::AlreadyExistsError("id");
    job.sequence = ++rows_.last_sequence;
    rows_.jobs[job.sequence] = job;
    return absl::OkStatus();
  }
  absl::Status update(const JobRecord& job) override {
    const std::lock_guard lock(rows_.mutex);
    if (!rows_.commit_fault.ok()) return rows_.commit_fault;
    rows_.jobs.at(job.sequence) = job;
    return absl::OkStatus();
  }
  absl::Status remove(const std::string& job_id) override {
    const std::lock_guard lock(rows_.mutex);
    if (!rows_.commit_fault.ok()) return rows_.commit_fault;
    for (const auto& [sequence, job] : rows_.jobs) {
      if (job.id == job_id) rows_.removed[job_id] = job.state;
    }
    std::erase_if(rows_.jobs, [&](const auto& entry) { return entry.second.id == job_id; });
    rows_.units.erase(job_id);
    rows_.totals.erase(job_id);
    rows_.frames.erase(job_id);
    return absl::OkStatus();
  }
  absl::StatusOr<std::vector<JobRecord>> list() const override {
    const std::lock_guard lock(rows_.mutex);
    std::vector<JobRecord> jobs;
    for (const auto& [sequence, job] : rows_.jobs) jobs.push_back(job);
    return jobs;
  }

  absl::StatusOr<std::optional<std::int32_t>> removed_state(
      const std::string& job_id) const override {
    const std::lock_guard lock(rows_.mutex);
    for (const auto& [sequence, job] : rows_.jobs) {
      if (job.id == job_id) return std::nullopt;
    }
    const auto found = rows_.removed.find(job_id);
    return found == rows_.removed.end() ? 0 : found->second;
  }
  absl::Status rewrite(const JobRecord& job, const std::vector<contract::Unit>& dropped) override {
    const std::lock_guard lock(rows_.mutex);
    if (!rows_.commit_fault.ok()) return rows_.commit_fault;
    for (const contract::Unit& unit : dropped) rows_.units[job.id].erase(unit);
    rows_.jobs.at(job.sequence) = job;
    return absl::OkStatus();
  }

 private:
  MemoryRows& rows_;
};

}  // namespace tessera::server
