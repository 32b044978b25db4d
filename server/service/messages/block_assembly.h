#pragma once

#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "server/coordinator/coordinator.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::server {

/// Assembles the blocks of a Deliver stream from their parts and passes each to the coordinator.
/// Allocates nothing for a block before the coordinator has admitted its header.
class BlockAssembly {
 public:
  /// `certificate`: name in the sender's certificate; empty: none.
  BlockAssembly(Coordinator& coordinator, std::string certificate)
      : coordinator_(coordinator), certificate_(std::move(certificate)) {}

  /// Takes the parts of a message. Errors: InvalidArgument, they violate the rules of Deliver;
  /// FailedPrecondition, the worker has no Work stream.
  absl::Status take(v1::DeliverRequest& request);

 private:
  absl::Status begin(const v1::BlockHeader& message);
  absl::Status append(std::string& chunk);
  void complete();

  Coordinator& coordinator_;
  const std::string certificate_;
  std::string worker_id_;
  bool is_open_ = false;  // a block is incomplete
  BlockHeader header_;
  bool is_compressed_ = false;
  std::optional<Admission> admission_;  // none: the bytes are skipped
  std::int64_t missing_bytes_ = 0;
  std::string bytes_;
};

}  // namespace tessera::server
