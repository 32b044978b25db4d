#include "server/identity/authority.h"

#include <arpa/inet.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <ctime>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/identity/openssl_objects.h"
#include "server/identity/private_file.h"
#include "server/identity/revocations.h"
#include "server/identity/signed_certificate.h"

namespace tessera::server {
namespace {

constexpr mode_t kPublic = 0644;
constexpr char kServerUri[] = "tessera://server/";

absl::Status write_pair(const KeyPair& pair, const std::string& certificate_path,
                        const std::string& key_path) {
  const auto certificate = to_pem(pair.certificate.get()), key = to_pem(pair.key.get());
  if (!certificate.ok()) return certificate.status();
  if (!key.ok()) return key.status();
  absl::Status status = write_file(key_path, *key, kPrivate);
  if (status.ok()) status = write_file(certificate_path, *certificate, kPublic);
  return status;
}

absl::StatusOr<KeyPair> read_authority(const std::string& folder) {
  const auto certificate_text = read_file(folder + "/ca.crt");
  const auto key_text = read_file(folder + "/ca.key");
  for (const auto& text : {certificate_text, key_text}) {
    if (text.ok()) continue;
    return absl::Status(text.status().code(),
                        absl::StrCat(std::string(text.status().message()),
                                     " (create the authority with `tessera-server init-certs`)"));
  }
  const Bio certificate(BIO_new_mem_buf(certificate_text->data(), -1));
  const Bio key(BIO_new_mem_buf(key_text->data(), -1));
  KeyPair pair;
  pair.certificate.reset(PEM_read_bio_X509(certificate.get(), nullptr, nullptr, nullptr));
  pair.key.reset(PEM_read_bio_PrivateKey(key.get(), nullptr, nullptr, nullptr));
  if (!pair.certificate || !pair.key ||
      X509_check_private_key(pair.certificate.get(), pair.key.get()) != 1) {
    return openssl_failed("use ca.crt with ca.key");
  }
  return pair;
}

/// Returns "IP:10.0.0.7" or "DNS:farm.example"; empty if `host` is neither. Nothing else reaches
/// OpenSSL's parser of such lists.
std::string subject_name_of(const std::string& host) {
  std::array<unsigned char, sizeof(in6_addr)> address{};
  if (::inet_pton(AF_INET, host.c_str(), address.data()) == 1 ||
      ::inet_pton(AF_INET6, host.c_str(), address.data()) == 1) {
    return "IP:" + host;
  }
  constexpr char kAllowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789.-*";
  const bool is_name =
      !host.empty() && host.size() <= 253 && host.find_first_not_of(kAllowed) == std::string::npos;
  return is_name ? "DNS:" + host : "";
}

std::string format_day(std::int64_t seconds) {
  const std::time_t time = seconds;
  std::tm utc{};
  ::gmtime_r(&time, &utc);
  std::array<char, 16> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%d", &utc);
  return text.data();
}

absl::Status record_issued(const std::string& folder, const X509* certificate,
                           const std::string& uri, const Validity& validity) {
  return append_file(folder + "/issued", absl::StrCat(serial_of(certificate), " ", uri, " ",
                                                      format_day(validity.until_s), "\n"));
}

/// Returns the host names and addresses among the subject alternative names.
std::vector<std::string> hosts_of(const X509* certificate) {
  const SubjectNames names(static_cast<GENERAL_NAMES*>(
      X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr)));
  std::vector<std::string> hosts;
  for (int i = 0; names && i < sk_GENERAL_NAME_num(names.get()); ++i) {
    const GENERAL_NAME* name = sk_GENERAL_NAME_value(names.get(), i);
    if (name->type != GEN_DNS && name->type != GEN_IPADD) continue;
    const ASN1_STRING* value = name->type == GEN_DNS ? name->d.dNSName : name->d.iPAddress;
    const unsigned char* bytes = ASN1_STRING_get0_data(value);
    const int size = ASN1_STRING_length(value);
    if (name->type == GEN_DNS) {
      hosts.emplace_back(reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size));
      continue;
    }
    std::array<char, INET6_ADDRSTRLEN> text{};
    const int family = size == sizeof(in_addr) ? AF_INET : AF_INET6;
    if (::inet_ntop(family, bytes, text.data(), text.size()) != nullptr) {
      hosts.emplace_back(text.data());
    }
  }
  return hosts;
}

/// Returns the validity of the certificate that follows one: as long, and with the same share of it
/// in the past, for clocks that are behind.
Validity following(const Validity& present, std::int64_t now_s) {
  constexpr std::int64_t kClockSkew = 3600, kShare = 10;
  const std::int64_t length = present.until_s - present.from_s;
  const std::int64_t from = now_s - std::min(kClockSkew, length / kShare);
  return {from, from + length};
}

Validity following(const Identity& present, std::int64_t now_s) {
  return following(Validity{present.issued_s, present.expires_s}, now_s);
}

/// The server's certificate.
struct ServerCertificate {
  std::vector<std::string> hosts;
  Validity validity;
};

/// Errors: InvalidArgument, it is no certificate, or names no hosts.
absl::StatusOr<ServerCertificate> read_server(const std::string& pem) {
  const Bio bytes(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
  const Certificate certificate(PEM_read_bio_X509(bytes.get(), nullptr, nullptr, nullptr));
  ServerCertificate server;
  if (certificate) {
    server.hosts = hosts_of(certificate.get());
    server.validity = validity_of(certificate.get());
  }
  if (server.hosts.empty()) {
    return absl::InvalidArgumentError("tls.crt: expected a certificate of host names");
  }
  return server;
}

}  // namespace

bool is_renewal_due(const Validity& validity, std::int64_t now_s) {
  return now_s >= validity.from_s + (validity.until_s - validity.from_s) / 3 * 2;
}

absl::Status make_authority(const std::string& folder, const Validity& validity) {
  if (absl::Status status = make_private_folder(folder); !status.ok()) return status;
  if (::access((folder + "/ca.crt").c_str(), F_OK) == 0) return absl::OkStatus();
  const Extensions extensions{"critical,CA:TRUE,pathlen:0", "critical,keyCertSign,cRLSign", nullptr,
                              ""};
  const auto pair = make_pair_signed("Tessera farm", extensions, validity, nullptr);
  if (!pair.ok()) return pair.status();
  return write_pair(*pair, folder + "/ca.crt", folder + "/ca.key");
}

absl::Status issue_server(const std::string& folder, const std::vector<std::string>& hosts,
                          const Validity& validity) {
  std::string names;
  for (const std::string& host : hosts) {
    const std::string name = subject_name_of(host);
    if (name.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat("--host \"", host, "\" is not a host name or IP address"));
    }
    absl::StrAppend(&names, names.empty() ? "" : ",", name);
  }
  if (names.empty()) return absl::InvalidArgumentError("at least one --host is required");
  const auto authority = read_authority(folder);
  if (!authority.ok()) return authority.status();
  const Extensions extensions{"critical,CA:FALSE", "critical,digitalSignature", "serverAuth",
                              names};
  const auto pair = make_pair_signed("Tessera server", extensions, validity, &*authority);
  if (!pair.ok()) return pair.status();
  absl::Status status =
      record_issued(folder, pair->certificate.get(), kServerUri + hosts.front(), validity);
  if (status.ok()) status = write_pair(*pair, folder + "/tls.crt", folder + "/tls.key");
  return status;
}

absl::Status issue(const std::string& folder, Role role, const std::string& name,
                   const std::string& out, const Validity& validity) {
  if (!is_identity_name(name)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "--name \"", name, "\" must be 1 to 64 of A-Z a-z 0-9 . _ - and not start with a dot"));
  }
  const auto authority = read_authority(folder);
  if (!authority.ok()) return authority.status();
  if (absl::Status status = make_private_folder(out); !status.ok()) return status;
  if (::access((out + "/tls.key").c_str(), F_OK) == 0) {
    return absl::AlreadyExistsError(
        absl::StrCat(out, "/tls.key already exists; choose another directory with --out"));
  }
  const std::string uri = identity_uri(role, name);
  const Extensions extensions{"critical,CA:FALSE", "critical,digitalSignature", "clientAuth",
                              "URI:" + uri};
  const auto pair = make_pair_signed(name, extensions, validity, &*authority);
  if (!pair.ok()) return pair.status();
  // Listed first: a certificate that is not listed could not be revoked.
  absl::Status status = record_issued(folder, pair->certificate.get(), uri, validity);
  if (status.ok()) status = write_pair(*pair, out + "/tls.crt", out + "/tls.key");
  if (!status.ok()) return status;
  const auto authority_text = read_file(folder + "/ca.crt");
  if (!authority_text.ok()) return authority_text.status();
  return write_file(out + "/ca.crt", *authority_text, kPublic);
}

namespace {

/// Checks that the list of issued certificates contains this one: another authority in ca.crt may
/// have signed it.
absl::Status check_issued(const std::string& folder, const std::string& uri,
                          const std::string& serial) {
  const auto issued = read_file(folder + "/issued");
  if (!issued.ok()) return issued.status();
  const std::string start = absl::StrCat(serial, " ", uri, " ");
  if (absl::StartsWith(*issued, start) || absl::StrContains(*issued, "\n" + start)) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(
      absl::StrCat("the certificate of ", uri, " was not issued by this farm's authority (it is ",
                   "not listed in ", folder, "/issued); have its issuer renew it"));
}

}  // namespace

absl::StatusOr<std::string> renew(const std::string& folder, const Identity& present,
                                  const std::string& signing_request, std::int64_t now_s) {
  const std::int64_t middle_s = present.issued_s + (present.expires_s - present.issued_s) / 2;
  if (now_s < middle_s) {
    return absl::FailedPreconditionError(absl::StrCat("the certificate can be renewed in ",
                                                      middle_s - now_s,
                                                      " s, when half of its validity has passed"));
  }
  const Bio bytes(
      BIO_new_mem_buf(signing_request.data(), static_cast<int>(signing_request.size())));
  const SigningRequest request(PEM_read_bio_X509_REQ(bytes.get(), nullptr, nullptr, nullptr));
  EVP_PKEY* const key = request ? X509_REQ_get0_pubkey(request.get()) : nullptr;
  if (key == nullptr || X509_REQ_verify(request.get(), key) != 1) {
    ERR_clear_error();
    return absl::InvalidArgumentError(
        "signing_request: expected a PKCS #10 request in PEM form, signed with its own key");
  }
  std::array<char, 32> group{};
  std::size_t size = 0;
  if (EVP_PKEY_get_group_name(key, group.data(), group.size(), &size) != 1 ||
      std::string(group.data(), size) != "prime256v1") {
    return absl::InvalidArgumentError("signing_request: expected a key on the curve P-256");
  }
  auto authority = read_authority(folder);
  if (absl::IsNotFound(authority.status())) {
    return absl::FailedPreconditionError(
        absl::StrCat("this server cannot renew certificates without ", folder,
                     "/ca.key; use `tessera-server issue-cert` where the authority's key is kept"));
  }
  if (!authority.ok()) return authority.status();
  const std::string uri = identity_uri(present.role, present.name);
  if (absl::Status status = check_issued(folder, uri, present.serial); !status.ok()) return status;
  Validity validity = following(present, now_s);
  validity.until_s = std::min(validity.until_s, validity_of(authority->certificate.get()).until_s);
  const Extensions extensions{"critical,CA:FALSE", "critical,digitalSignature", "clientAuth",
                              "URI:" + uri};
  const auto certificate = sign_certificate(key, present.name, extensions, validity, &*authority);
  if (!certificate.ok()) return certificate.status();
  absl::Status status = record_issued(folder, certificate->get(), uri, validity);
  if (!status.ok()) return status;
  // After it is listed: either revoke() finds the new certificate, or this finds the old one
  // revoked.
  if (Revocations(folder + "/revoked").contains(present.serial)) {
    return absl::UnauthenticatedError(absl::StrCat("the certificate of ", uri, " is revoked"));
  }
  return to_pem(certificate->get());
}

absl::StatusOr<ServerRenewal> renew_server(const std::string& folder, std::int64_t now_s) {
  constexpr std::int64_t kPart = 30;  // of the certificate's time, between two looks
  ServerRenewal renewal;
  if (::access((folder + "/ca.key").c_str(), F_OK) != 0) return renewal;
  const auto text = read_file(folder + "/tls.crt");
  if (!text.ok()) return text.status();
  const auto present = read_server(*text);
  if (!present.ok()) return present.status();
  const std::int64_t length = present->validity.until_s - present->validity.from_s;
  renewal.again_s = std::clamp(length / kPart, std::int64_t{1}, renewal.again_s);
  if (!is_renewal_due(present->validity, now_s)) return renewal;
  absl::Status status = issue_server(folder, present->hosts, following(present->validity, now_s));
  if (!status.ok()) return status;
  renewal.is_renewed = true;
  return renewal;
}

namespace {

/// Adds the certificates of this URI that are issued and not revoked yet to `revoked`; returns
/// whether there are any.
absl::StatusOr<bool> revoke_issued(const std::string& folder, const std::string& uri) {
  const auto issued = read_file(folder + "/issued");
  if (!issued.ok()) return issued.status();
  const auto revoked = read_file(folder + "/revoked");
  if (!revoked.ok() && !absl::IsNotFound(revoked.status())) return revoked.status();
  const std::vector<std::string> known = absl::StrSplit(revoked.value_or(""), '\n');
  const std::vector<std::string> lines = absl::StrSplit(*issued, '\n');
  std::string added;
  for (const std::string& line : lines) {
    const std::vector<std::string> words = absl::StrSplit(line, ' ');
    if (words.size() < 2 || words[1] != uri) continue;
    if (std::find(known.begin(), known.end(), line) != known.end()) continue;
    absl::StrAppend(&added, line, "\n");
  }
  if (added.empty()) return false;
  if (absl::Status status = append_file(folder + "/revoked", added); !status.ok()) return status;
  return true;
}

}  // namespace

absl::Status revoke(const std::string& folder, Role role, const std::string& name) {
  const std::string uri = identity_uri(role, name);
  bool has_any = false;
  // Again until nothing is added: a server that renewed a certificate meanwhile has listed it
  // before it looked whether the old one is revoked (renew()).
  for (bool has_more = true; has_more;) {
    const auto added = revoke_issued(folder, uri);
    if (!added.ok()) return added.status();
    has_more = *added;
    has_any = has_any || has_more;
  }
  if (has_any) return absl::OkStatus();
  return absl::NotFoundError(
      absl::StrCat(folder, "/issued: no certificate of ", uri, " that is not revoked"));
}

}  // namespace tessera::server
