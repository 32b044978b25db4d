#include "server/service/access/numerics_check.h"

#include "absl/strings/str_cat.h"
#include "contract/digest.h"
#include "contract/version.h"

namespace tessera::server {

absl::Status check_numerics(int contract_version, const std::string& numerics_sha256) {
  if (contract_version != contract::kRenderContract) {
    return absl::FailedPreconditionError(
        absl::StrCat("this worker has render contract ", contract_version, ", this server ",
                     contract::kRenderContract, ": install the server's version of the worker"));
  }
  const auto digest = contract::Digest::from_binary(numerics_sha256);
  if (!digest) return absl::InvalidArgumentError("hello.numerics_sha256: expected 32 bytes");
  if (digest->hex() == contract::kNumericsSha256) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("numerics hash ", digest->hex(), " differs from render contract ",
                   contract::kRenderContract, "'s ", contract::kNumericsSha256,
                   ": this worker computes other pixels; use the released packages, or check the "
                   "versions of its image libraries and its compiler flags"));
}

}  // namespace tessera::server
