#include "server/service/numerics_gate.h"

#include <cstdio>
#include <fstream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/contract/version.h"

namespace tessera::server {

NumericsGate::NumericsGate(std::string path) : path_(std::move(path)) {
  std::ifstream input(path_);
  int version = 0;
  std::string hex;
  if (input >> version >> hex && version == contract::kRenderContract) {
    expected_ = contract::Digest::from_hex(hex);
  }
}

absl::Status NumericsGate::check(int contract_version, const std::string& numerics_sha256) {
  if (contract_version != contract::kRenderContract) {
    return absl::FailedPreconditionError(
        absl::StrCat("the worker has render contract ", contract_version, ", this server ",
                     contract::kRenderContract, ": install the server's version"));
  }
  const auto digest = contract::Digest::from_binary(numerics_sha256);
  if (!digest) return absl::InvalidArgumentError("hello.numerics_sha256: is not 32 bytes");
  const std::lock_guard lock(mutex_);
  if (!expected_) {
    expected_ = digest;
    const std::string part = path_ + ".part";
    std::ofstream(part) << contract::kRenderContract << ' ' << digest->hex() << '\n';
    std::rename(part.c_str(), path_.c_str());
  }
  if (*expected_ == *digest) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(
      "numerics hash ", digest->hex(), " differs from this farm's ", expected_->hex(),
      ": this worker would render other pixels; install the version the other workers have"));
}

}  // namespace tessera::server
