#pragma once

#include <grpcpp/support/status.h>

#include <string>

#include "absl/status/status.h"

namespace tessera::contract {

/// Converts a status for gRPC. Both enums are the canonical codes, number for number.
inline grpc::Status to_rpc(const absl::Status& status) {
  return {static_cast<grpc::StatusCode>(status.code()), std::string(status.message())};
}

/// Converts a status from gRPC.
inline absl::Status from_rpc(const grpc::Status& status) {
  return {static_cast<absl::StatusCode>(status.error_code()), status.error_message()};
}

}  // namespace tessera::contract
