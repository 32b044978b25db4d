#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "server/identity/identity.h"

namespace tessera::server {

// The farm's certificate authority, in one directory:
//
//   ca.crt, ca.key    the authority; only issuing needs the key, which may be kept elsewhere
//   tls.crt, tls.key  the server's certificate
//   issued, revoked   a line per certificate: serial number, tessera://ROLE/NAME, last day
//
// Kubernetes and cert-manager use the names ca.crt, tls.crt and tls.key too; a client's or worker's
// directory has the same. Keys are ECDSA P-256, mode 0600; files are replaced by rename.

/// Period in which a certificate is valid; seconds since 1970.
struct Validity {
  std::int64_t from_s = 0, until_s = 0;
};

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

/// Revokes all certificates issued to this name so far. One issued later is valid.
///
/// Errors: NotFound, no certificate that is not revoked.
absl::Status revoke(const std::string& folder, Role role, const std::string& name);

}  // namespace tessera::server
