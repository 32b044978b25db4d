#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/store/files/filesystem.h"
#include "server/store/maintenance/check.h"

namespace tessera::server {

/// Copies a store, which a server may be using, into the folder `copy`, which must not exist: the
/// rows as of one moment, and every file they promise. The copy is durable and checked (check.h) on
/// return; what the check found in it is the result, without faults.
///
/// The copy is a store of its own, with an id of its own: a worker that comes to it from the
/// original drops what it holds, since the two no longer agree on what was leased. Session keys and
/// join tokens hold for both.
///
/// Errors: AlreadyExists, `copy` is there; NotFound, there is no store; DataLoss, three tries in a
/// row found something missing or damaged (the message says what); ResourceExhausted, no room;
/// FailedPrecondition, it has another schema.
absl::StatusOr<StoreFindings> back_up_store(const std::string& folder, const std::string& copy,
                                            Filesystem& filesystem);

}  // namespace tessera::server
