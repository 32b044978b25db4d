#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "worker/agent/units/unit_queue.h"
#include "worker/ipc/descriptor.h"

namespace tessera::agent {

/// Log of a worker's unit state changes, which tests compare with the server's record. Lines:
/// "started JOB FRAME TILE PASS", "finished … SHA256", "failed … MESSAGE" and, for an
/// acknowledgement, its status ("COMMITTED …"). Each line is a single write, so a killed worker
/// leaves only whole lines.
class UnitLog {
 public:
  /// Discards all lines.
  UnitLog() = default;
  /// Appends to `path`. Errors: FailedPrecondition, the file cannot be opened.
  static absl::StatusOr<UnitLog> open(const std::string& path);

  void write(const char* event, const UnitKey& key, const std::string& more = {});

 private:
  Descriptor file_;
};

}  // namespace tessera::agent
