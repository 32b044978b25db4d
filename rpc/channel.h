#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/security/credentials.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::contract {

/// Metadata key of the token: that of a loopback server, or a worker's join token or session key.
inline constexpr char kTokenKey[] = "tessera-token";

/// Trailing metadata key of a refused call that can be retried after a pause: the client makes too
/// many calls.
inline constexpr char kRetryKey[] = "tessera-retry";

/// Returns whether the call of `context` has ended with such a refusal.
bool is_refused_for_now(const grpc::ClientContext& context);

/// Maximum size of a gRPC message in either direction (docs/reference/limits.md).
inline constexpr int kMaxMessageBytes = 4 << 20;

/// Returns whether `address` (unix:PATH, HOST:PORT) is reachable only from this machine: a Unix
/// socket or a loopback host.
bool is_local_address(const std::string& address);

/// Time after which a connection without messages counts as lost. A ping is sent after 1.5 s
/// without a message; its answer must arrive within the rest of the time.
enum class Keepalive : std::uint8_t {
  interactive,  // 4.5 s: streams resume within 5 s
  bulk,         // 11.5 s: for data that delays the answers to pings on a slow line
};

/// Opens a channel to a server: plaintext over a Unix socket, or over loopback if `certs` is empty,
/// else mutual TLS with the certificates in the directory `certs`. HTTP proxies are never used.
/// A Unix socket needs no keepalive.
///
/// Errors: InvalidArgument, a remote address without certificates; those of channel_credentials().
absl::StatusOr<std::shared_ptr<grpc::Channel>> open_channel(
    const std::string& address, const std::string& certs,
    Keepalive keepalive = Keepalive::interactive);
/// The same with credentials that channels may share.
std::shared_ptr<grpc::Channel> open_channel(
    const std::string& address, const std::shared_ptr<grpc::ChannelCredentials>& credentials,
    Keepalive keepalive = Keepalive::interactive);

/// Sets the deadline that every unary call needs, and the token unless it is empty.
void prepare_call(grpc::ClientContext& context, const std::string& token,
                  std::chrono::milliseconds timeout);

}  // namespace tessera::contract
