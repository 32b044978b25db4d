#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::contract {

using WallTime = std::chrono::system_clock::time_point;

/// Returns the time at which the first certificate in a PEM file expires. Errors: NotFound;
/// InvalidArgument, the file contains no certificate.
absl::StatusOr<WallTime> certificate_end(const std::string& path);

/// Returns the time at which it becomes valid. Errors: as certificate_end().
absl::StatusOr<WallTime> certificate_begin(const std::string& path);

/// Returns the role and the name in the first certificate of a PEM file, "ROLE/NAME" of its URI
/// tessera://ROLE/NAME; "" if it has none.
std::string certificate_holder(const std::string& path);

/// Returns a time as text for messages, UTC, with minutes.
std::string date_text(WallTime time);

/// Returns a line for the log if a certificate in the directory `certs` (tls.crt, ca.crt) expires
/// within three weeks or has expired; otherwise, and if `certs` is empty, "".
std::string expiry_warning(const std::string& certs, WallTime now);
/// The same for one file.
std::string file_expiry_warning(const std::string& path, WallTime now);

/// Tells a worker whether a refusal may be due to its own certificate, which has expired and can be
/// replaced while the worker runs.
class CertificateRenewal {
 public:
  /// `certs`: directory of tls.crt; empty: no TLS.
  explicit CertificateRenewal(std::string certs);

  /// Returns whether the certificate with which this process connected has expired. Stays true for
  /// a while after its file has been replaced, until connections with the old one have been closed.
  bool explains_refusal(WallTime now);

 private:
  std::string path_;
  WallTime end_ = WallTime::max();  // of the certificate in use
  std::optional<WallTime> replaced_at_;
};

}  // namespace tessera::contract
