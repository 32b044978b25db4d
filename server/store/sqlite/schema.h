#pragma once

#include "absl/status/status.h"
#include "server/store/sqlite/database.h"

namespace tessera::server {

/// Brings the tables of a store to the version that this program writes, each step in a transaction
/// of its own.
///
/// Errors: FailedPrecondition, a newer program wrote them; DataLoss, this is another kind of file.
absl::Status migrate(Database& database);

/// Whether the tables are of the version that this program writes. Errors: as migrate(), and
/// FailedPrecondition, an older program wrote them.
absl::Status check_schema(Database& database);

}  // namespace tessera::server
