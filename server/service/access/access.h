#pragma once

#include <grpcpp/server_context.h>

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/identity/identity.h"
#include "server/identity/revocations.h"
#include "server/service/access/client_limits.h"

namespace tessera::server {

/// Who calls.
struct Caller {
  /// From its certificate; absent on a Unix socket and under the store's token, where whoever gets
  /// through is the user who runs the farm and may do everything.
  std::optional<Identity> identity;
  /// Its place among the client's open streams; given back with the last copy of this. Null if the
  /// call is no stream, or the caller no client.
  std::shared_ptr<const void> stream;

  /// Whom the jobs it makes belong to.
  std::string owner() const { return identity ? identity->name : "local"; }
  /// Whose jobs it sees; empty: everybody's.
  std::string sees() const {
    return identity && identity->role != Role::admin ? identity->name : "";
  }
  /// Under which certificate it works; empty: none.
  std::string certificate() const { return identity ? identity->name : ""; }
};

/// Which roles may call an rpc. Admins may call all.
struct AccessRule {
  const char* rpc;  // "JobService.CreateJob"
  bool client, worker;
  bool is_stream;  // counts while it is open
};

/// The rule for an rpc; nullptr: there is none, and nobody may call it.
const AccessRule* find_access_rule(std::string_view rpc);

/// Who may call what: on a Unix socket everybody who can open it (its folder is private), on
/// loopback TCP whoever sends the store's token, with certificates whom the rules allow. Any
/// thread.
class Access {
 public:
  /// `token`: empty for a Unix socket.
  explicit Access(std::string token) : token_(std::move(token)) {}
  /// Callers come with certificates, which TLS has verified.
  explicit Access(std::unique_ptr<Revocations> revocations, ClientRates rates = {});

  /// Who the caller is, if it may call `rpc`.
  ///
  /// Errors: Unauthenticated, no token or a wrong one, or a certificate that is revoked, has
  /// expired or names no role; PermissionDenied, not with this role; ResourceExhausted, too many
  /// streams of this client are open; Unavailable, it calls too often.
  absl::StatusOr<Caller> admit(const grpc::CallbackServerContext& context,
                               std::string_view rpc) const;
  /// Whether a caller admitted earlier still would be; for streams that stay open.
  absl::Status recheck(const Caller& caller) const;
  /// Counts what a caller is about to upload. Errors: ResourceExhausted, more than it may.
  absl::Status count_upload(const Caller& caller, std::int64_t bytes) const;

 private:
  absl::StatusOr<Caller> identify(const grpc::CallbackServerContext& context) const;

  std::string token_;
  std::unique_ptr<Revocations> revocations_;  // null: no certificates
  std::unique_ptr<ClientLimits> limits_;      // null likewise
};

/// What the caller sent as its token; empty if nothing.
std::string sent_token(const grpc::CallbackServerContext& context);

}  // namespace tessera::server
