#include "server/identity/signed_certificate.h"

#include <openssl/err.h>
#include <openssl/pem.h>

#include <ctime>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr int kSerialBits = 127;  // random, and positive in 16 bytes

bool add_extension(X509* certificate, X509V3_CTX& context, int nid, const std::string& value) {
  const Extension extension(X509V3_EXT_conf_nid(nullptr, &context, nid, value.c_str()));
  return extension && X509_add_ext(certificate, extension.get(), -1) == 1;
}

bool add_extensions(X509* made, const X509* issuer, const Extensions& wanted, bool is_root) {
  X509V3_CTX context;
  X509V3_set_ctx(&context, const_cast<X509*>(issuer), made, nullptr, nullptr, 0);
  bool ok = add_extension(made, context, NID_basic_constraints, wanted.constraints) &&
            add_extension(made, context, NID_key_usage, wanted.usage) &&
            add_extension(made, context, NID_subject_key_identifier, "hash");
  if (ok && !is_root) {
    ok = add_extension(made, context, NID_authority_key_identifier, "keyid:always");
  }
  if (ok && wanted.purpose != nullptr) {
    ok = add_extension(made, context, NID_ext_key_usage, wanted.purpose);
  }
  if (ok && !wanted.names.empty()) {
    ok = add_extension(made, context, NID_subject_alt_name, wanted.names);
  }
  return ok;
}

}  // namespace

absl::Status openssl_failed(const char* what) {
  const unsigned long code = ERR_get_error();
  const char* reason = ERR_reason_error_string(code);
  ERR_clear_error();
  return absl::InternalError(absl::StrCat("OpenSSL cannot ", what, reason == nullptr ? "" : ": ",
                                          reason == nullptr ? "" : reason));
}

std::string text_of(BIO* bio) {
  char* bytes = nullptr;
  const long size = BIO_get_mem_data(bio, &bytes);
  return {bytes, static_cast<std::size_t>(size)};
}

absl::StatusOr<Certificate> sign_certificate(EVP_PKEY* key, const std::string& common_name,
                                             const Extensions& wanted, const Validity& validity,
                                             const KeyPair* authority) {
  Certificate certificate(X509_new());
  const Bignum serial(BN_new());
  X509* const made = certificate.get();
  if (made == nullptr || !serial) return openssl_failed("create a certificate");
  const X509* const issuer = authority == nullptr ? made : authority->certificate.get();
  EVP_PKEY* const signer = authority == nullptr ? key : authority->key.get();
  X509_NAME* const subject = X509_get_subject_name(made);
  const auto* name = reinterpret_cast<const unsigned char*>(common_name.c_str());
  const bool ok = X509_set_version(made, X509_VERSION_3) == 1 &&
                  BN_rand(serial.get(), kSerialBits, BN_RAND_TOP_ANY, BN_RAND_BOTTOM_ANY) == 1 &&
                  BN_to_ASN1_INTEGER(serial.get(), X509_get_serialNumber(made)) != nullptr &&
                  ASN1_TIME_set(X509_getm_notBefore(made), validity.from_s) != nullptr &&
                  ASN1_TIME_set(X509_getm_notAfter(made), validity.until_s) != nullptr &&
                  X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_UTF8, name, -1, -1, 0) == 1 &&
                  X509_set_issuer_name(made, X509_get_subject_name(issuer)) == 1 &&
                  X509_set_pubkey(made, key) == 1 &&
                  add_extensions(made, issuer, wanted, authority == nullptr);
  if (!ok || X509_sign(made, signer, EVP_sha256()) == 0) {
    return openssl_failed("create a certificate");
  }
  return certificate;
}

absl::StatusOr<KeyPair> make_pair_signed(const std::string& common_name, const Extensions& wanted,
                                         const Validity& validity, const KeyPair* authority) {
  KeyPair pair;
  pair.key.reset(EVP_EC_gen("P-256"));
  if (!pair.key) return openssl_failed("create a key");
  auto certificate = sign_certificate(pair.key.get(), common_name, wanted, validity, authority);
  if (!certificate.ok()) return certificate.status();
  pair.certificate = *std::move(certificate);
  return pair;
}

Validity validity_of(const X509* certificate) {
  std::tm from{}, until{};
  if (ASN1_TIME_to_tm(X509_get0_notBefore(certificate), &from) != 1 ||
      ASN1_TIME_to_tm(X509_get0_notAfter(certificate), &until) != 1) {
    return {};
  }
  return {::timegm(&from), ::timegm(&until)};
}

absl::StatusOr<std::string> to_pem(X509* certificate) {
  const Bio bio(BIO_new(BIO_s_mem()));
  if (PEM_write_bio_X509(bio.get(), certificate) != 1) {
    return openssl_failed("write a certificate");
  }
  return text_of(bio.get());
}

absl::StatusOr<std::string> to_pem(EVP_PKEY* key) {
  const Bio bio(BIO_new(BIO_s_mem()));
  if (PEM_write_bio_PKCS8PrivateKey(bio.get(), key, nullptr, nullptr, 0, nullptr, nullptr) != 1) {
    return openssl_failed("write a key");
  }
  return text_of(bio.get());
}

}  // namespace tessera::server
