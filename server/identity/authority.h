#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/identity/identity.h"
#include "server/identity/signed_certificate.h"

namespace tessera::server {

// The farm's certificate authority, in one directory:
//
//   ca.crt, ca.key    the authority; only issuing needs the key, which may be kept elsewhere
//   tls.crt, tls.key  the server's certificate
//   issued, revoked   a line per certificate: serial number, tessera://ROLE/NAME, last day
//
// Kubernetes and cert-manager use the names ca.crt, tls.crt and tls.key too; a client's or worker's
// directory has the same. Keys are ECDSA P-256, mode 0600; files are replaced by rename.

/// Creates the authority's certificate and key unless they exist. Creates the directory if missing,
/// mode 0700.
///
/// Errors, here and below: PermissionDenied and others of errno, naming the file; Internal, OpenSSL
/// failed.
absl::Status make_authority(const std::string& folder, const Validity& validity);

/// Issues the server's certificate for the host names and IP addresses under which clients and
/// workers reach it. Replaces an existing one; a running server loads the new one by itself.
///
/// Errors: InvalidArgument, no hosts or an invalid one; NotFound, no authority.
absl::Status issue_server(const std::string& folder, const std::vector<std::string>& hosts,
                          const Validity& validity);

/// Issues a certificate into directory `out`, with the authority's beside it, and lists it in
/// `issued`.
///
/// Errors: InvalidArgument, invalid name; NotFound, no authority; AlreadyExists, `out` has a key.
absl::Status issue(const std::string& folder, Role role, const std::string& name,
                   const std::string& out, const Validity& validity);

/// Returns a certificate, in PEM form, that follows `present` for the key of a signing request
/// (PKCS #10, PEM): the same role and name, valid as long from now on. Lists it in `issued`.
///
/// Errors: InvalidArgument, the request is malformed or its key is not on P-256;
/// FailedPrecondition, less than half of the present one's validity has passed, the authority's key
/// is not in `folder`, or the present one is not in `issued`; Unauthenticated, it is revoked.
absl::StatusOr<std::string> renew(const std::string& folder, const Identity& present,
                                  const std::string& signing_request, std::int64_t now_s);

/// Returns whether two thirds of a certificate's validity have passed.
bool is_renewal_due(const Validity& validity, std::int64_t now_s);

/// Result of renew_server().
struct ServerRenewal {
  bool is_renewed = false;
  std::int64_t again_s = 3600;  // time after which it should be called again
};
/// Replaces the server's certificate by one for the same hosts if it is due and the authority's key
/// is in `folder`.
absl::StatusOr<ServerRenewal> renew_server(const std::string& folder, std::int64_t now_s);

/// Revokes all certificates issued to this name so far. One issued later is valid.
///
/// Errors: NotFound, no certificate that is not revoked.
absl::Status revoke(const std::string& folder, Role role, const std::string& name);

}  // namespace tessera::server
