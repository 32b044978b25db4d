#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/store/files/filesystem.h"

namespace tessera::server {

/// The result of recover_store(): rows that were kept, and places where some are lost.
struct Recovery {
  struct Table {
    std::string name;
    std::int64_t rows = 0;  // copied
    int gaps = 0;           // places at which an unknown number of rows is lost
  };
  std::vector<Table> tables;
  std::int64_t dropped_rows = 0;  // copied, but of no use without others that are lost
  std::string damaged;            // path of the old database
};

/// Replaces the damaged database of a store by one with all rows that can still be read. The old
/// one stays as store.db.damaged. Durable on return.
///
/// A damaged page of a table is a gap. Rows behind it are found again by their keys: all of them
/// where the key is one number, otherwise those behind the last gap and those of later jobs.
/// The other rows of the store stay consistent: units without their block, and frames without their
/// image, are dropped, so that the server renders them again. Files are not touched; the next start
/// of the server deletes those of lost rows.
///
/// Errors: NotFound, no store; FailedPrecondition, a process uses it, it has another schema, or its
/// database is not damaged; AlreadyExists, there is a store.db.damaged; DataLoss, the list of
/// tables cannot be read; ResourceExhausted, the disk is full.
absl::StatusOr<Recovery> recover_store(const std::string& folder, Filesystem& filesystem);

}  // namespace tessera::server
