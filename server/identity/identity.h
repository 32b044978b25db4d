#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace tessera::server {

/// Role of a certificate's holder.
enum class Role : std::uint8_t { client, worker, admin };

/// "client", "worker", "admin".
const char* role_name(Role role);
std::optional<Role> parse_role(std::string_view text);

/// Returns whether `name` is valid: 1 to 64 of [A-Za-z0-9._-], not starting with a dot.
bool is_identity_name(std::string_view name);

/// The holder of a certificate.
struct Identity {
  Role role = Role::client;
  std::string name;
  std::string serial;                        // of the certificate, hexadecimal
  std::int64_t issued_s = 0, expires_s = 0;  // start and end of its validity, since 1970
};

/// Returns tessera://ROLE/NAME, the one URI among a certificate's subject alternative names.
std::string identity_uri(Role role, std::string_view name);

/// Reads a certificate in PEM form, whose signature and validity TLS has verified.
///
/// Errors: Unauthenticated, it is not a certificate or has no role and name.
absl::StatusOr<Identity> read_identity(std::string_view pem);

}  // namespace tessera::server
