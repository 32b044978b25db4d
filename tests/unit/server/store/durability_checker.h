#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "server/store/store.h"

namespace tessera::server {

/// Options of a store that keeps blocks, images and assets in files, however small they are.
inline StoreOptions files_only() {
  StoreOptions options;
  options.row_block_bytes = options.row_image_bytes = options.row_asset_bytes = 0;
  return options;
}

/// Records what a store has confirmed. A confirmation holds from the step at which a call returned
/// until the step at which a call that revokes it began.
class DurabilityChecker {
 public:
  /// Returns what is wrong, or an empty string.
  using Test = std::function<std::string(Store&)>;

  /// `key` names the confirmation, so that it can be ended or replaced.
  void make(const std::string& key, int step, Test test);
  /// An unknown key is no error.
  void end(const std::string& key, int step);
  /// Ends all confirmations whose key starts with `prefix`.
  void end_all(const std::string& prefix, int step);

  /// Returns what is wrong with a store after a power cut at `step`, or an empty string.
  std::string check(Store& store, int step) const;
  /// Steps at which something was confirmed.
  std::vector<int> steps() const;

 private:
  struct Confirmation {
    std::string key;
    int from = 0;
    int until = 0;
    Test test;
  };
  std::vector<Confirmation> confirmations_;
};

/// A block of `bytes` for a unit, as a worker would send it.
Commit make_commit(const std::string& job_id, contract::Unit unit, std::string bytes);

/// Tests for DurabilityChecker.
DurabilityChecker::Test has_job(const JobRecord& job);
DurabilityChecker::Test id_is_taken(const std::string& job_id);
DurabilityChecker::Test has_unit(const std::string& job_id, contract::Unit unit, std::string bytes);
/// The job has this number of units, with a row each or in totals: none is lost or counted twice.
DurabilityChecker::Test counts_units(const std::string& job_id, std::int64_t units);
DurabilityChecker::Test worker_has_joined(const std::string& worker_id);
DurabilityChecker::Test has_frame(const std::string& job_id, const FrameRecord& frame,
                                  std::string bytes);
DurabilityChecker::Test has_asset(std::string bytes);
DurabilityChecker::Test worker_is_known(const std::string& worker_id);
DurabilityChecker::Test booted_before(std::int64_t boot_count, const std::string& id,
                                      const std::string& key);
DurabilityChecker::Test sequence_was_used(std::int64_t sequence);

/// Invariants of any store at any time: rows point to complete data, ids are unique, no unexpected
/// file is visible. `folder`: the store's. Returns what is wrong, or an empty string.
std::string check_store(Store& store, const std::string& folder,
                        const std::vector<std::string>& asset_bytes);

/// Everything that a store contains, one fact per line.
std::vector<std::string> facts(Store& store);

std::string read_file(const std::string& path);

/// Returns the bytes of an asset; empty if it cannot be read.
std::string read_asset(Store& store, const contract::Digest& digest);

/// Returns the path of the file of a large asset.
std::string asset_file(const std::string& folder, const contract::Digest& digest);

}  // namespace tessera::server
