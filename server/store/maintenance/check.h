#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/store/files/filesystem.h"

namespace tessera::server {

/// Result of verifying every byte of a store.
struct StoreFindings {
  std::vector<std::string> faults;   // rows whose data is missing or different
  std::vector<std::string> orphans;  // files without a row; the next start deletes them
  std::int64_t jobs = 0, units = 0, blocks = 0, frames = 0, assets = 0;
};

/// Compares the rows of a store with its files: all blocks that are not released, all finished
/// frames and all assets exist and match their digests. Read-only.
///
/// Errors: NotFound, no store; FailedPrecondition, a process uses it, or it has another schema than
/// this program's; DataLoss, its database is unreadable.
absl::StatusOr<StoreFindings> check_store(const std::string& folder, Filesystem& filesystem);

}  // namespace tessera::server
