#pragma once

#include <grpcpp/server_context.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/identity/identity.h"
#include "server/identity/revocations.h"
#include "server/service/access/open_streams.h"
#include "server/service/quotas/client_limits.h"

namespace tessera::server {

/// The caller of an rpc.
struct Caller {
  /// From its certificate; absent on a Unix socket and with the store's token, where every caller
  /// is the user who runs the farm and may do everything.
  std::optional<Identity> identity;
  /// Entry in the table of open streams and, for a client, reservation in its stream quota;
  /// released with the last copy, which must be in OnDone at the latest. Null for unary calls and
  /// without a certificate.
  std::shared_ptr<const void> stream;

  /// Owner of the jobs it creates.
  std::string owner() const { return identity ? identity->name : "local"; }
  /// Owner of the jobs that it can see; empty: all jobs.
  std::string visible_owner() const {
    return identity && identity->role != Role::admin ? identity->name : "";
  }
  /// Name in its certificate; empty: none.
  std::string certificate() const { return identity ? identity->name : ""; }
};

/// Roles that may call an rpc. Admins may call all.
struct AccessRule {
  const char* rpc;  // "JobService.CreateJob"
  bool client, worker;
  bool is_stream;  // counts towards the stream limit while it is open
};

/// Returns the rule of an rpc; nullptr: no rule, nobody may call it.
const AccessRule* find_access_rule(std::string_view rpc);

/// Decides who may call what: on a Unix socket everybody who can open it (its directory is
/// private), on loopback TCP callers with the store's token, with certificates callers whose role
/// the rules allow. Thread-safe.
class Access {
 public:
  /// `token` is empty for a Unix socket.
  explicit Access(std::string token) : token_(std::move(token)) {}
  /// Callers have certificates, which TLS has verified.
  explicit Access(std::unique_ptr<Revocations> revocations, ClientQuotas quotas = {},
                  std::function<void(const QuotaKind&)> refused = {});

  /// Identifies the caller and checks that it may call `rpc`.
  ///
  /// Errors: Unauthenticated, no token or a wrong one, or a certificate that is revoked, expired or
  /// without a role; PermissionDenied, the role may not call it; ResourceExhausted, this client has
  /// too many open connections, streams or calls in progress, or calls too often. Answer with
  /// finish() or refuse() (service/finish.h).
  absl::StatusOr<Caller> admit(grpc::CallbackServerContext& context, std::string_view rpc) const;
  /// Checks that a caller admitted earlier is still allowed; for long streams, which can then end
  /// with a status that says why.
  absl::Status recheck(const Caller& caller) const;
  /// Reads which certificates have been revoked. Ends the streams of their holders and of those
  /// whose certificates have expired, whatever they wait for, and connections over a client's
  /// quota. Call about twice a second, on one thread.
  void cut_refused() const;
  /// Counts bytes that a caller is about to upload. Errors: ResourceExhausted, limit exceeded.
  absl::Status count_upload(const Caller& caller, std::int64_t bytes) const;
  /// The limits of clients; null without certificates.
  const ClientLimits* limits() const { return limits_.get(); }
  /// The connections of callers; null without certificates.
  ClientConnections* connections() const { return limits_ ? &limits_->connections() : nullptr; }

 private:
  absl::StatusOr<Caller> identify(const grpc::CallbackServerContext& context) const;
  absl::Status count_call(grpc::CallbackServerContext& context, const std::string& client,
                          bool is_stream) const;

  std::string token_;
  std::unique_ptr<Revocations> revocations_;  // null without certificates
  std::unique_ptr<ClientLimits> limits_;      // null without certificates
  std::unique_ptr<OpenStreams> streams_;      // null without certificates
};

/// Returns the token in the caller's metadata; empty if there is none.
std::string sent_token(const grpc::CallbackServerContext& context);

}  // namespace tessera::server
