#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <chrono>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::contract {

/// Metadata key that carries the token of a loopback server; to a server with certificates, a
/// worker's join token or session key.
inline constexpr char kTokenKey[] = "tessera-token";

/// Largest gRPC message either side takes (farm.md, section 9).
inline constexpr int kMaxMessageBytes = 4 << 20;

/// Whether `address` (unix:PATH, HOST:PORT) can be reached only from this machine: a Unix socket
/// or a loopback host.
bool is_local_address(const std::string& address);

/// A channel to a server: plaintext over a Unix socket, or over loopback if `certs` is empty, else
/// mutual TLS with the certificates in the folder `certs`. HTTP proxies are never used.
///
/// Errors: InvalidArgument, another machine's address without certificates; those of
/// channel_credentials().
absl::StatusOr<std::shared_ptr<grpc::Channel>> open_channel(const std::string& address,
                                                            const std::string& certs);

/// Sets the deadline every unary call needs, and the token where there is one.
void prepare_call(grpc::ClientContext& context, const std::string& token,
                  std::chrono::milliseconds timeout);

}  // namespace tessera::contract
