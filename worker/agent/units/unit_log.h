#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "worker/ipc/descriptor.h"
#include "worker/agent/units/unit_queue.h"

namespace tessera::agent {

/// A worker's own account of its units, one line each, for tests that hold it against what the
/// server acknowledged: "started JOB FRAME TILE PASS", "finished … SHA256", "VERDICT …",
/// "failed … MESSAGE". A line is one write, so a kill leaves whole lines.
class UnitLog {
 public:
  /// Says nothing.
  UnitLog() = default;
  /// Appends to `path`. Errors: FailedPrecondition naming it.
  static absl::StatusOr<UnitLog> open(const std::string& path);

  void write(const char* event, const UnitKey& key, const std::string& more = {});

 private:
  Descriptor file_;
};

}  // namespace tessera::agent
