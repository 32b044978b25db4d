#include "server/identity/identity.h"

#include <openssl/pem.h>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "rpc/certificates/certificate_uri.h"
#include "server/identity/openssl_objects.h"
#include "server/identity/signed_certificate.h"
#include "server/store/files/names.h"

namespace tessera::server {
namespace {

constexpr std::size_t kMaxNameLength = 64;

}  // namespace

const char* role_name(Role role) {
  switch (role) {
    case Role::client:
      return "client";
    case Role::worker:
      return "worker";
    case Role::admin:
      return "admin";
  }
  return "";
}

std::optional<Role> parse_role(std::string_view text) {
  for (const Role role : {Role::client, Role::worker, Role::admin}) {
    if (text == role_name(role)) return role;
  }
  return std::nullopt;
}

bool is_identity_name(std::string_view name) {
  return name.size() <= kMaxNameLength && is_plain_name(name);
}

std::string identity_uri(Role role, std::string_view name) {
  return absl::StrCat(contract::kHolderScheme, role_name(role), "/", std::string(name));
}

absl::StatusOr<Identity> read_identity(std::string_view pem) {
  const Bio bytes(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
  const Certificate certificate(PEM_read_bio_X509(bytes.get(), nullptr, nullptr, nullptr));
  if (!certificate) return absl::UnauthenticatedError("invalid certificate");
  const std::string uri = contract::holder_uri(certificate.get());
  const std::size_t slash = uri.rfind('/');
  const std::size_t scheme = sizeof contract::kHolderScheme - 1;
  Identity identity;
  const auto role = uri.size() > scheme && slash >= scheme
                        ? parse_role(std::string_view(uri).substr(scheme, slash - scheme))
                        : std::nullopt;
  if (role) identity.name = uri.substr(slash + 1);
  if (!role || !is_identity_name(identity.name)) {
    return absl::UnauthenticatedError(
        "the certificate has no role: expected one URI tessera://client|worker|admin/NAME "
        "(issue it with `tessera-server issue-cert`)");
  }
  identity.role = *role;
  identity.serial = serial_of(certificate.get());
  const Validity validity = validity_of(certificate.get());
  if (validity.until_s == 0) {
    return absl::UnauthenticatedError("the certificate's dates are invalid");
  }
  identity.issued_s = validity.from_s;
  identity.expires_s = validity.until_s;
  return identity;
}

}  // namespace tessera::server
