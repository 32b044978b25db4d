#pragma once

#include <grpcpp/security/credentials.h>
#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::contract {

// Mutual TLS from a folder that holds ca.crt, tls.crt and tls.key. Either side accepts only
// certificates of that authority; a client also checks that the server's is for the host it called.
// The files are watched: replaced ones hold for connections made from then on.
//
// Errors: NotFound, a file is missing; PermissionDenied, one cannot be read, or tls.key can be read
// by every user.

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> channel_credentials(
    const std::string& folder);
absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> server_credentials(
    const std::string& folder);

}  // namespace tessera::contract
