#include "cli/exit_codes.h"

#include <cstdio>
#include <cstdlib>

#include "absl/base/config.h"

namespace tessera::cli {

int exit_code(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kOk:
      return kExitDone;
    case absl::StatusCode::kCancelled:
      return kExitInterrupted;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kUnimplemented:
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kOutOfRange:
      return kExitBadInput;
    default:
      return kExitUnavailable;
  }
}

int end_process(int exit_code) {
  // AddressSanitizer looks for leaks and gcov writes its counts after main().
#if !defined(ABSL_HAVE_ADDRESS_SANITIZER) && !defined(TESSERA_COVERAGE)
  std::fflush(nullptr);
  std::_Exit(exit_code);
#endif
  return exit_code;
}

}  // namespace tessera::cli
