#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "server/store/sqlite/database.h"

namespace tessera::server {

/// Schema version that this program writes, in the database's `user_version`.
std::int64_t schema_version();

/// Migrates a store's tables to schema_version(), each step in a transaction of its own.
///
/// Errors: FailedPrecondition, a newer program wrote the store, which is left unchanged; DataLoss,
/// the file is another program's database.
absl::Status migrate(Database& database);

/// Checks that the tables have schema_version(). Errors: those of migrate(); FailedPrecondition, an
/// older program wrote the store.
absl::Status check_schema(Database& database);

}  // namespace tessera::server
