#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "server/store/farm/settings_store.h"
#include "server/store/farm/worker_store.h"
#include "tests/support/memory_store/memory_rows.h"

namespace tessera::server {

/// Workers in memory.
class MemoryWorkers final : public WorkerStore {
 public:
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

 private:
  mutable std::mutex mutex_;
  std::set<std::string> roster_, banned_;
  std::map<std::string, std::set<std::string>> joins_;  // by token
};

/// Settings in memory.
class MemorySettings final : public SettingsStore {
 public:
  explicit MemorySettings(const MemoryRows& rows) : rows_(rows) {}

  absl::Status save(SettingKind kind, const Settings& settings) override {
    const std::lock_guard lock(rows_.mutex);
    if (!rows_.commit_fault.ok()) return rows_.commit_fault;
    settings_[kind] = settings;
    return absl::OkStatus();
  }
  absl::StatusOr<Settings> read(SettingKind kind) const override {
    const std::lock_guard lock(rows_.mutex);
    const auto found = settings_.find(kind);
    return found == settings_.end() ? Settings{} : found->second;
  }

 private:
  const MemoryRows& rows_;  // has the failures
  std::map<SettingKind, Settings> settings_;
};

}  // namespace tessera::server
