#pragma once

#include <openssl/bio.h>
#include <openssl/bn.h>
#include <openssl/evp.h>
#include <openssl/x509v3.h>

#include <memory>

namespace tessera::server {

// Owning pointers to OpenSSL objects; null if OpenSSL failed.

template <auto Free>
struct OpensslFree {
  template <typename Object>
  void operator()(Object* object) const {
    Free(object);
  }
};

using Bio = std::unique_ptr<BIO, OpensslFree<BIO_free>>;
using Bignum = std::unique_ptr<BIGNUM, OpensslFree<BN_free>>;
using Certificate = std::unique_ptr<X509, OpensslFree<X509_free>>;
using Extension = std::unique_ptr<X509_EXTENSION, OpensslFree<X509_EXTENSION_free>>;
using PrivateKey = std::unique_ptr<EVP_PKEY, OpensslFree<EVP_PKEY_free>>;
using SigningRequest = std::unique_ptr<X509_REQ, OpensslFree<X509_REQ_free>>;
using SubjectNames = std::unique_ptr<GENERAL_NAMES, OpensslFree<GENERAL_NAMES_free>>;

/// Returns a certificate's serial number, hexadecimal.
inline std::string serial_of(const X509* certificate) {
  const Bignum number(ASN1_INTEGER_to_BN(X509_get0_serialNumber(certificate), nullptr));
  char* const digits = number ? BN_bn2hex(number.get()) : nullptr;
  std::string text(digits == nullptr ? "" : digits);
  OPENSSL_free(digits);
  return text;
}

}  // namespace tessera::server
