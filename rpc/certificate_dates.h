#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::contract {

using WallTime = std::chrono::system_clock::time_point;

/// Returns the moment at which the first certificate in a PEM file ends. Errors: NotFound;
/// InvalidArgument, the file holds no certificate.
absl::StatusOr<WallTime> certificate_end(const std::string& path);

/// Returns the moment at which it becomes valid. Errors: as certificate_end().
absl::StatusOr<WallTime> certificate_begin(const std::string& path);

/// Returns a line for the log if a certificate in the directory `certs` (tls.crt, ca.crt) ends
/// within three weeks or has ended; empty otherwise. An empty directory name has none.
std::string expiry_warning(const std::string& certs, WallTime now);

/// Tells a worker whether a refusal may come from its own certificate, which has ended and can be
/// replaced while it runs.
class CertificateRenewal {
 public:
  /// `certs`: directory of tls.crt; empty: no TLS.
  explicit CertificateRenewal(std::string certs);

  /// Returns whether the certificate with which this process connected has ended. Stays true for a
  /// while after its file has been replaced, until connections with the old one have been closed.
  bool explains_refusal(WallTime now);

 private:
  std::string path_;
  WallTime end_ = WallTime::max();  // of the certificate in use
  std::optional<WallTime> replaced_at_;
};

}  // namespace tessera::contract
