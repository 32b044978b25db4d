#include "server/store/sqlite/store_id.h"

#include <sys/random.h>

#include <cstddef>

#include "absl/strings/escaping.h"

namespace tessera::server {
namespace {

constexpr std::size_t kIdBytes = 16, kKeyBytes = 32;

}  // namespace

absl::StatusOr<StoreId> new_store_id() {
  std::string id(kIdBytes, '\0'), key(kKeyBytes, '\0');
  if (::getentropy(id.data(), id.size()) != 0 || ::getentropy(key.data(), key.size()) != 0) {
    return absl::UnavailableError("getentropy failed");
  }
  return StoreId{absl::BytesToHexString(id), key};
}

}  // namespace tessera::server
