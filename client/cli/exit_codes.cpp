#include "client/cli/exit_codes.h"

namespace tessera::client {

int failed_job_exit_code(absl::StatusCode code) {
  const bool scene_is_at_fault = code == absl::StatusCode::kInvalidArgument ||
                                 code == absl::StatusCode::kNotFound ||
                                 code == absl::StatusCode::kUnimplemented;
  return scene_is_at_fault ? kExitBadInput : kExitJobFailed;
}

}  // namespace tessera::client
