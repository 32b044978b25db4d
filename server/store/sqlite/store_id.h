#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace tessera::server {

/// Who a store is: the fields `id` (hexadecimal) and `key` of its row in the table store.
struct StoreId {
  std::string id, key;
};

/// Returns a new random ID and key. Errors: Unavailable, the kernel gave no random bytes.
absl::StatusOr<StoreId> new_store_id();

}  // namespace tessera::server
