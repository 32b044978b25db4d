#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "server/store/database.h"

namespace tessera::server {

/// The version of the tables that this program writes.
extern const std::int64_t kSchemaVersion;

/// Brings the tables of a store to kSchemaVersion, each step in a transaction of its own.
///
/// Errors: FailedPrecondition, a newer program wrote them; DataLoss, this is another kind of file.
absl::Status migrate(Database& database);

}  // namespace tessera::server
