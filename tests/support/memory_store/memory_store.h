#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <utility>

#include "server/store/store.h"
#include "tests/support/memory_store/memory_accounts.h"
#include "tests/support/memory_store/memory_assets.h"
#include "tests/support/memory_store/memory_farm.h"
#include "tests/support/memory_store/memory_frames.h"
#include "tests/support/memory_store/memory_jobs.h"
#include "tests/support/memory_store/memory_rows.h"
#include "tests/support/memory_store/memory_units.h"

namespace tessera::server {

/// A store in memory with injected failures: rows and blocks outlive the coordinator that wrote
/// them; images are files in `folder`.
class MemoryStore final : public Store {
 public:
  explicit MemoryStore(const std::string& folder) : frames_(rows_, folder), assets_(folder) {}

  /// Faults and values that tests inject.
  class Controls {
   public:
    explicit Controls(MemoryStore& store) : store_(store) {}
    /// Makes UnitStore::commit(), FrameStore::finish() and changes of a job's row fail with
    /// `status` from now on; OK ends it.
    void fail_commits_with(absl::Status status) {
      const std::lock_guard lock(store_.rows_.mutex);
      store_.rows_.commit_fault = std::move(status);
    }
    /// Makes commits of this job fail with `status`.
    void fail_commits_of(const std::string& job_id, absl::Status status) {
      const std::lock_guard lock(store_.rows_.mutex);
      store_.rows_.job_faults[job_id] = std::move(status);
    }
    /// Makes write_together() fail, with nothing written, from now on; OK ends it.
    void fail_transactions_with(absl::Status status) {
      const std::lock_guard lock(store_.rows_.mutex);
      store_.rows_.transaction_fault = std::move(status);
    }
    /// Runs each transaction's body within `act`, which must call it.
    void wrap_transactions(std::function<void(const std::function<void()>& body)> act) {
      store_.wrap_ = std::move(act);
    }
    /// Number of calls of write_together().
    int transaction_count() const { return store_.transaction_count_; }
    /// Deletes the rows of removed jobs, as after many removals.
    void forget_removed_jobs() {
      const std::lock_guard lock(store_.rows_.mutex);
      store_.rows_.removed.clear();
    }
    void reboot() { ++store_.boot_count_; }
    void set_used_bytes(std::int64_t bytes) { store_.used_bytes_ = bytes; }
    void set_free_bytes(std::int64_t bytes) { store_.free_bytes_ = bytes; }

   private:
    MemoryStore& store_;
  };
  Controls controls() { return Controls(*this); }

  const std::string& folder() const override { return folder_; }
  const std::string& id() const override { return id_; }
  const std::string& key() const override { return key_; }
  std::int64_t boot_count() const override { return boot_count_; }

  absl::Status write_together(const std::function<void()>& body) override {
    absl::Status fault;
    {
      const std::lock_guard lock(rows_.mutex);
      ++transaction_count_;
      fault = rows_.transaction_fault;
    }
    if (fault.ok() && wrap_) wrap_(body);
    if (fault.ok() && !wrap_) body();
    return fault;
  }

  MemoryJobs& jobs() override { return jobs_; }
  MemoryUnits& units() override { return units_; }
  const MemoryUnits& units() const override { return units_; }
  MemoryFrames& frames() override { return frames_; }
  const MemoryFrames& frames() const override { return frames_; }
  MemoryAssets& assets() override { return assets_; }
  const MemoryAssets& assets() const override { return assets_; }
  MemoryEvents& events() override { return events_; }
  const MemoryEvents& events() const override { return events_; }
  const MemoryUsage& usage() const override { return usage_; }
  MemoryWorkers& workers() override { return workers_; }
  MemorySettings& settings() override { return settings_; }

  std::int64_t free_bytes() const override { return free_bytes_; }
  std::int64_t used_bytes() const override { return used_bytes_; }

 private:
  MemoryRows rows_;
  MemoryUsage usage_;
  MemoryEvents events_;
  MemoryWorkers workers_;
  MemorySettings settings_{rows_};
  MemoryJobs jobs_{rows_};
  MemoryUnits units_{rows_, usage_};
  MemoryFrames frames_;
  MemoryAssets assets_;
  const std::string folder_ = "/srv/store";
  const std::string id_ = "0123456789abcdef0123456789abcdef";
  const std::string key_ = "thirty-two bytes of a secret key";
  std::int64_t boot_count_ = 1, used_bytes_ = 0;
  std::int64_t free_bytes_ = std::int64_t{1} << 40;
  int transaction_count_ = 0;
  std::function<void(const std::function<void()>&)> wrap_;
};

}  // namespace tessera::server
