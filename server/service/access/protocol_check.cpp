#include "server/service/access/protocol_check.h"

#include "absl/strings/str_cat.h"
#include "rpc/protocol_version.h"

namespace tessera::server {

absl::Status check_protocol(const std::string& program, int protocol_version) {
  constexpr int kOldest = contract::kOldestProtocolVersion, kNewest = contract::kProtocolVersion;
  if (protocol_version >= kOldest && protocol_version <= kNewest) return absl::OkStatus();
  const bool is_older = protocol_version < kOldest;
  return absl::FailedPreconditionError(absl::StrCat(
      "this ", program, " speaks protocol version ", protocol_version,
      protocol_version == 0 ? " (none was sent)" : "", ", this server version ", kNewest,
      is_older ? ": upgrade the " : ": upgrade the server, or install its version of the ",
      program));
}

}  // namespace tessera::server
