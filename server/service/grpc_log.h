#pragma once

#include "telemetry/log/log.h"

namespace tessera::server {

/// Number of lines per minute that gRPC writes to the log at most.
inline constexpr int kGrpcLinesPerMinute = 10;

/// Sends gRPC's own lines to `log`, from the process's first call on until it ends. gRPC writes one
/// for each failed handshake, so whoever reaches the port could fill the disk of the log. Does
/// nothing if GRPC_VERBOSITY or GRPC_TRACE is set, because all lines are wanted then.
void limit_grpc_log(const Log& log);

}  // namespace tessera::server
