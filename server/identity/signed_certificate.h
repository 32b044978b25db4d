#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/identity/openssl_objects.h"

namespace tessera::server {

/// Period in which a certificate is valid; seconds since 1970.
struct Validity {
  std::int64_t from_s = 0, until_s = 0;
};

/// A certificate and its key, which is null if somebody else has it.
struct KeyPair {
  Certificate certificate;
  PrivateKey key;
};

/// Extensions of a certificate, in OpenSSL's notation.
struct Extensions {
  const char* constraints;
  const char* usage;
  const char* purpose;  // null: none
  std::string names;    // empty: none
};

/// Returns Internal with OpenSSL's last error.
absl::Status openssl_failed(const char* what);

/// Returns the text that was written to `bio`.
std::string text_of(BIO* bio);

/// Creates a certificate for `key` (a public key suffices), signed by `authority`, or by `key`
/// itself if that is null. Errors, here and below: Internal, OpenSSL failed.
absl::StatusOr<Certificate> sign_certificate(EVP_PKEY* key, const std::string& common_name,
                                             const Extensions& wanted, const Validity& validity,
                                             const KeyPair* authority);

/// Creates a key and its certificate.
absl::StatusOr<KeyPair> make_pair_signed(const std::string& common_name, const Extensions& wanted,
                                         const Validity& validity, const KeyPair* authority);

/// Returns the dates of a certificate; 0 for those that are malformed.
Validity validity_of(const X509* certificate);

/// Returns a certificate, or a key, in PEM form.
absl::StatusOr<std::string> to_pem(X509* certificate);
absl::StatusOr<std::string> to_pem(EVP_PKEY* key);

}  // namespace tessera::server
