#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/store/files/filesystem.h"

namespace tessera::server {

/// What a look at every byte of a store has found.
struct StoreFindings {
  std::vector<std::string> faults;   // a row promises what is not there, or not as it says
  std::vector<std::string> orphans;  // files that no row knows; the next start removes them
  std::int64_t jobs = 0, units = 0, blocks = 0, frames = 0, assets = 0;
};

/// Compares the rows of a store with its files: every block that is not released, every finished
/// frame and every asset is there and has the digest of its row. Changes nothing.
///
/// Errors: NotFound, there is no store; FailedPrecondition, a process uses it, or it has another
/// schema than this program's; DataLoss, its database cannot be read at all.
absl::StatusOr<StoreFindings> check_store(const std::string& folder, Filesystem& filesystem);

}  // namespace tessera::server
