#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "rpc/certificates/certificate_dates.h"

namespace tessera::contract {

/// A new key on P-256 and the request to sign it (PKCS #10), both in PEM form.
struct NewKey {
  std::string key, signing_request;
};
/// Errors: Internal, OpenSSL failed.
absl::StatusOr<NewKey> make_key();

/// Returns the time at which the certificate DIR/tls.crt is due for renewal: when two thirds of its
/// validity have passed. Errors: as certificate_end().
absl::StatusOr<WallTime> renewal_time(const std::string& folder);

/// Lock on the files of a directory, also between processes that share it. Released by the
/// destructor.
class CertificateLock {
 public:
  /// Errors: Unavailable, another process has it; PermissionDenied, the directory cannot be
  /// written.
  static absl::StatusOr<std::unique_ptr<CertificateLock>> take(const std::string& folder);
  ~CertificateLock();
  CertificateLock(const CertificateLock&) = delete;
  CertificateLock& operator=(const CertificateLock&) = delete;

 private:
  explicit CertificateLock(int file) : file_(file) {}
  const int file_;
};

/// Replaces DIR/tls.key and DIR/tls.crt durably; owner and mode stay the same. A process that is
/// killed in between leaves tls.renewed, from which finish_install() resumes. Requires the
/// directory's lock.
///
/// Errors: InvalidArgument, the certificate is not of this key; those of errno.
absl::Status install_certificate(const std::string& folder, std::string_view key,
                                 std::string_view certificate);

/// Completes an installation that was interrupted; does nothing otherwise. Requires the directory's
/// lock. Errors: those of errno.
absl::Status finish_install(const std::string& folder);
/// The same without the lock. Does nothing if the files belong to another user.
void repair_install(const std::string& folder);

}  // namespace tessera::contract
