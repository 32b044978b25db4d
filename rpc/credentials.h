#pragma once

#include <grpcpp/security/credentials.h>
#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::contract {

// Mutual TLS with the files ca.crt, tls.crt and tls.key of a directory. Either side accepts only
// certificates of that authority; a client also checks the server's host name. The files are
// watched: new connections use replaced ones.
//
// Errors: NotFound, a file is missing; PermissionDenied, a file cannot be read, or tls.key is
// readable by every user.

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> channel_credentials(
    const std::string& folder);
absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> server_credentials(
    const std::string& folder);

}  // namespace tessera::contract
