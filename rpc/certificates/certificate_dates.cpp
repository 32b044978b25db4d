#include "rpc/certificates/certificate_dates.h"

#include <openssl/bio.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <ctime>
#include <memory>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "absl/time/time.h"
#include "rpc/certificates/certificate_uri.h"

namespace tessera::contract {
namespace {

constexpr std::chrono::hours kNotice{24 * 21};
/// Longer than a server keeps a connection without closing it (server/service/server.cpp).
constexpr std::chrono::minutes kHandover{15};

using Certificate = std::unique_ptr<X509, void (*)(X509*)>;

/// Reads the first certificate in a PEM file. Errors: as certificate_end().
absl::StatusOr<Certificate> read_certificate(const std::string& path) {
  const std::unique_ptr<BIO, int (*)(BIO*)> file(BIO_new_file(path.c_str(), "r"), BIO_free);
  if (file == nullptr) return absl::NotFoundError(absl::StrCat(path, ": cannot read the file"));
  Certificate certificate(PEM_read_bio_X509(file.get(), nullptr, nullptr, nullptr), X509_free);
  if (certificate == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": contains no certificate"));
  }
  return certificate;
}

/// Reads a date of the first certificate in a PEM file.
absl::StatusOr<WallTime> date_of(const std::string& path,
                                 const ASN1_TIME* (*read_date)(const X509*)) {
  const auto certificate = read_certificate(path);
  if (!certificate.ok()) return certificate.status();
  std::tm date{};
  if (ASN1_TIME_to_tm(read_date(certificate->get()), &date) != 1) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": contains no certificate"));
  }
  return std::chrono::system_clock::from_time_t(::timegm(&date));
}

}  // namespace

absl::StatusOr<WallTime> certificate_begin(const std::string& path) {
  return date_of(path, X509_get0_notBefore);
}

absl::StatusOr<WallTime> certificate_end(const std::string& path) {
  return date_of(path, X509_get0_notAfter);
}

std::string certificate_holder(const std::string& path) {
  const auto certificate = read_certificate(path);
  if (!certificate.ok()) return {};
  return std::string(absl::StripPrefix(holder_uri(certificate->get()), kHolderScheme));
}

std::string date_text(WallTime time) {
  return absl::FormatTime("%Y-%m-%d %H:%M UTC", absl::FromChrono(time), absl::UTCTimeZone());
}

std::string expiry_warning(const std::string& certs, WallTime now) {
  if (certs.empty()) return {};
  for (const char* name : {"/tls.crt", "/ca.crt"}) {
    std::string warning = file_expiry_warning(certs + name, now);
    if (!warning.empty()) return warning;
  }
  return {};
}

std::string file_expiry_warning(const std::string& path, WallTime now) {
  const auto end = certificate_end(path);
  if (!end.ok() || *end - now > kNotice) return {};
  return absl::StrCat(
      path, now < *end ? ": the certificate expires at " : ": the certificate expired at ",
      date_text(*end), "; replace it with `tessera-server issue-cert` or ",
      "`init-certs`, no restart is needed");
}

CertificateRenewal::CertificateRenewal(std::string certs)
    : path_(certs.empty() ? std::string() : std::move(certs) + "/tls.crt") {
  if (!path_.empty()) end_ = certificate_end(path_).value_or(WallTime::max());
}

bool CertificateRenewal::explains_refusal(WallTime now) {
  if (path_.empty() || now < end_) return false;
  const auto stored = certificate_end(path_);
  if (!stored.ok() || *stored <= now) return true;
  if (!replaced_at_) replaced_at_ = now;
  if (now - *replaced_at_ < kHandover) return true;
  end_ = *stored;
  replaced_at_.reset();
  return false;
}

}  // namespace tessera::contract
