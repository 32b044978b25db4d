#include "server/service/grpc_log.h"

#include <grpc/support/log.h>

#include <chrono>
#include <cstdlib>
#include <string>

#include "absl/strings/str_cat.h"
#include "telemetry/log/log_limit.h"

namespace tessera::server {
namespace {

/// gRPC's hook is a function without context. Never destroyed, because gRPC's threads outlive
/// main().
struct GrpcLog {
  Log log;
  LogLimit limit{kGrpcLinesPerMinute, std::chrono::seconds(60)};
};
GrpcLog* grpc_log = nullptr;

void write(gpr_log_func_args* line) {
  const auto left_out = grpc_log->limit.admit(std::chrono::steady_clock::now());
  if (!left_out) return;
  if (*left_out > 0) {
    grpc_log->log(LogLevel::warn, absl::StrCat("gRPC: ", *left_out, " lines left out"));
  }
  const std::string file(line->file);
  grpc_log->log(LogLevel::warn,
                absl::StrCat("gRPC: ", line->message, " (", file.substr(file.rfind('/') + 1), ":",
                             line->line, ")"));
}

}  // namespace

void limit_grpc_log(const Log& log) {
  if (grpc_log != nullptr || std::getenv("GRPC_VERBOSITY") != nullptr ||
      std::getenv("GRPC_TRACE") != nullptr) {
    return;
  }
  grpc_log = new GrpcLog{log};
  gpr_set_log_function(&write);
}

}  // namespace tessera::server
