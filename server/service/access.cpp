#include "server/service/access.h"

#include "proto/contract/channel.h"
#include "proto/contract/digest.h"

namespace tessera::server {

absl::Status Access::check(const grpc::CallbackServerContext& context) const {
  if (token_.empty()) return absl::OkStatus();
  const auto& metadata = context.client_metadata();
  const auto sent = metadata.find(contract::kTokenKey);
  if (sent == metadata.end()) {
    return absl::UnauthenticatedError("this server needs the token in STORE/token");
  }
  const std::string_view text(sent->second.data(), sent->second.size());
  if (contract::equal_in_constant_time(contract::sha256(text), contract::sha256(token_))) {
    return absl::OkStatus();
  }
  return absl::UnauthenticatedError("wrong token: this server's is in STORE/token");
}

}  // namespace tessera::server
