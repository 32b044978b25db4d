#pragma once

#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "server/coordinator/coordinator.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::server {

/// Puts the blocks of one Deliver stream together from their parts and hands each to the
/// coordinator. Nothing is allocated for a block before the coordinator has admitted its header.
class BlockAssembly {
 public:
  /// `certificate`: name of the one the blocks come under; empty: none.
  BlockAssembly(Coordinator& coordinator, std::string certificate)
      : coordinator_(coordinator), certificate_(std::move(certificate)) {}

  /// Takes the parts out of a message. Errors: InvalidArgument, they do not follow the rules of
  /// Deliver; FailedPrecondition, the worker has no Work stream.
  absl::Status take(v1::DeliverRequest& request);

 private:
  absl::Status begin(const v1::BlockHeader& message);
  absl::Status append(std::string& chunk);
  void complete();

  Coordinator& coordinator_;
  const std::string certificate_;
  std::string worker_id_;
  bool is_open_ = false;  // a block has begun and is not complete
  BlockHeader header_;
  bool is_compressed_ = false;
  std::optional<Admission> admission_;  // none: the bytes are skipped
  std::int64_t missing_bytes_ = 0;
  std::string bytes_;
};

}  // namespace tessera::server
