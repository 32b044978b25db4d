#pragma once

#include <string_view>

#include "absl/status/status.h"
#include "contract/digest.h"
#include "server/store/sqlite/database.h"

namespace tessera::server {

/// Returns a digest as a value of a row. It points into `digest`.
inline Blob blob_of(const contract::Digest& digest) {
  return {{reinterpret_cast<const char*>(digest.bytes.data()), digest.bytes.size()}};
}

/// Reads a digest from the bytes of a row. Errors: DataLoss, they are none.
inline absl::Status read_digest(std::string_view bytes, contract::Digest& digest) {
  const auto read = contract::Digest::from_binary(bytes);
  if (!read.has_value()) return absl::DataLossError("a digest in store.db is damaged");
  digest = *read;
  return absl::OkStatus();
}

}  // namespace tessera::server
