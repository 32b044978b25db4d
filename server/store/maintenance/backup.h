#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/store/files/filesystem.h"
#include "server/store/maintenance/check.h"

namespace tessera::server {

/// Copies a store, which a server may be using, to the new directory `copy`: the rows as of one
/// moment, and all files they refer to. The copy is durable and verified (check.h) on return;
/// returns the findings of that check, without faults.
///
/// The copy is a store with an ID of its own: a worker that connects to it drops the units of the
/// original, because the two stores no longer agree on leases. Session keys and join tokens are
/// valid for both.
///
/// Errors: AlreadyExists, `copy` exists; NotFound, no store; DataLoss, three attempts found
/// something missing or damaged (the message says what); ResourceExhausted, the disk is full;
/// FailedPrecondition, another schema.
absl::StatusOr<StoreFindings> back_up_store(const std::string& folder, const std::string& copy,
                                            Filesystem& filesystem);

}  // namespace tessera::server
