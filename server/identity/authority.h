#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "server/identity/identity.h"

namespace tessera::server {

// A farm's own certificate authority, in one folder:
//
//   ca.crt, ca.key    the authority. Only issuing takes the key: it may be kept elsewhere
//   tls.crt, tls.key  the server's certificate
//   issued, revoked   a line a certificate: serial number, tessera://ROLE/NAME, last day
//
// ca.crt, tls.crt and tls.key are the names Kubernetes and cert-manager give such files, in a
// client's or worker's folder too. Keys are ECDSA P-256, mode 0600; files are replaced by rename.

/// When a certificate is in force; seconds since 1970.
struct Validity {
  std::int64_t from_s = 0, until_s = 0;
};

/// Makes the authority's certificate and key; leaves those there are. The folder is made if need
/// be, mode 0700.
///
/// Errors, here and below: PermissionDenied and others of errno, naming the file; Internal,
/// OpenSSL failed.
absl::Status make_authority(const std::string& folder, const Validity& validity);

/// Issues the server's certificate for what clients and workers call it by: host names and IP
/// addresses. A present one is replaced; a running server takes the new one up by itself.
///
/// Errors: InvalidArgument, no hosts or one that cannot be a host's name; NotFound, no authority.
absl::Status issue_server(const std::string& folder, const std::vector<std::string>& hosts,
                          const Validity& validity);

/// Issues a certificate into folder `out`, with the authority's beside it; notes it in `issued`.
///
/// Errors: InvalidArgument, the name; NotFound, no authority; AlreadyExists, `out` has a key.
absl::Status issue(const std::string& folder, Role role, const std::string& name,
                   const std::string& out, const Validity& validity);

/// Lists every certificate issued to this name so far as revoked. One issued later is good again.
///
/// Errors: NotFound, none was issued that is not revoked already.
absl::Status revoke(const std::string& folder, Role role, const std::string& name);

}  // namespace tessera::server
