#include "client/cli/exit_codes.h"

namespace tessera::client {
namespace {

struct ExitCodes {
  absl::StatusCode code;
  int call;  // a call or a local step failed with the code
  int job;   // a job failed with the code
};

constexpr ExitCodes kExitCodes[] = {
    {absl::StatusCode::kOk, kExitDone, kExitJobFailed},
    {absl::StatusCode::kCancelled, kExitInterrupted, kExitJobFailed},
    {absl::StatusCode::kInvalidArgument, kExitBadInput, kExitBadInput},
    {absl::StatusCode::kNotFound, kExitBadInput, kExitBadInput},
    {absl::StatusCode::kUnimplemented, kExitBadInput, kExitBadInput},
    {absl::StatusCode::kAlreadyExists, kExitBadInput, kExitJobFailed},
    {absl::StatusCode::kFailedPrecondition, kExitBadInput, kExitJobFailed},
    {absl::StatusCode::kOutOfRange, kExitBadInput, kExitJobFailed},
};
constexpr ExitCodes kOthers = {absl::StatusCode::kUnknown, kExitUnreachable, kExitJobFailed};

const ExitCodes& find(absl::StatusCode code) {
  for (const ExitCodes& entry : kExitCodes) {
    if (entry.code == code) return entry;
  }
  return kOthers;
}

}  // namespace

int exit_code(absl::StatusCode code) {
  return find(code).call;
}

int failed_job_exit_code(absl::StatusCode code) {
  return find(code).job;
}

}  // namespace tessera::client
