#include "server/identity/authority.h"

#include <arpa/inet.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <ctime>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/identity/openssl_objects.h"
#include "server/identity/private_file.h"

namespace tessera::server {
namespace {

constexpr mode_t kPublic = 0644;
constexpr int kSerialBits = 127;  // random, and positive in 16 bytes

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

struct KeyPair {
  Certificate certificate;
  PrivateKey key;
};

absl::Status write_pair(const KeyPair& pair, const std::string& certificate_path,
                        const std::string& key_path) {
  const Bio certificate(BIO_new(BIO_s_mem())), key(BIO_new(BIO_s_mem()));
  if (PEM_write_bio_X509(certificate.get(), pair.certificate.get()) != 1 ||
      PEM_write_bio_PKCS8PrivateKey(key.get(), pair.key.get(), nullptr, nullptr, 0, nullptr,
                                    nullptr) != 1) {
    return openssl_failed("write a certificate");
  }
  absl::Status status = write_file(key_path, text_of(key.get()), kPrivate);
  if (status.ok()) status = write_file(certificate_path, text_of(certificate.get()), kPublic);
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

bool add_extension(X509* certificate, X509V3_CTX& context, int nid, const std::string& value) {
  const Extension extension(X509V3_EXT_conf_nid(nullptr, &context, nid, value.c_str()));
  return extension && X509_add_ext(certificate, extension.get(), -1) == 1;
}

struct Extensions {
  const char* constraints;
  const char* usage;
  const char* purpose;  // null: none
  std::string names;    // empty: none
};

/// Creates a key and its certificate, signed by `authority`, or self-signed if that is null.
absl::StatusOr<KeyPair> make_pair_signed(const std::string& common_name, const Extensions& wanted,
                                         const Validity& validity, const KeyPair* authority) {
  KeyPair pair;
  pair.key.reset(EVP_EC_gen("P-256"));
  pair.certificate.reset(X509_new());
  const Bignum serial(BN_new());
  X509* const made = pair.certificate.get();
  if (!pair.key || made == nullptr || !serial) return openssl_failed("create a key");
  const X509* const issuer = authority == nullptr ? made : authority->certificate.get();
  EVP_PKEY* const signer = authority == nullptr ? pair.key.get() : authority->key.get();
  X509_NAME* const subject = X509_get_subject_name(made);
  const auto* name = reinterpret_cast<const unsigned char*>(common_name.c_str());
  bool ok = X509_set_version(made, X509_VERSION_3) == 1 &&
            BN_rand(serial.get(), kSerialBits, BN_RAND_TOP_ANY, BN_RAND_BOTTOM_ANY) == 1 &&
            BN_to_ASN1_INTEGER(serial.get(), X509_get_serialNumber(made)) != nullptr &&
            ASN1_TIME_set(X509_getm_notBefore(made), validity.from_s) != nullptr &&
            ASN1_TIME_set(X509_getm_notAfter(made), validity.until_s) != nullptr &&
            X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_UTF8, name, -1, -1, 0) == 1 &&
            X509_set_issuer_name(made, X509_get_subject_name(issuer)) == 1 &&
            X509_set_pubkey(made, pair.key.get()) == 1;
  X509V3_CTX context;
  X509V3_set_ctx(&context, const_cast<X509*>(issuer), made, nullptr, nullptr, 0);
  ok = ok && add_extension(made, context, NID_basic_constraints, wanted.constraints) &&
       add_extension(made, context, NID_key_usage, wanted.usage) &&
       add_extension(made, context, NID_subject_key_identifier, "hash");
  if (ok && authority != nullptr) {
    ok = add_extension(made, context, NID_authority_key_identifier, "keyid:always");
  }
  if (ok && wanted.purpose != nullptr) {
    ok = add_extension(made, context, NID_ext_key_usage, wanted.purpose);
  }
  if (ok && !wanted.names.empty()) {
    ok = add_extension(made, context, NID_subject_alt_name, wanted.names);
  }
  if (!ok || X509_sign(made, signer, EVP_sha256()) == 0)
    return openssl_failed("create a certificate");
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

}  // namespace

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
      record_issued(folder, pair->certificate.get(), "tessera://server/" + hosts.front(), validity);
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

absl::Status revoke(const std::string& folder, Role role, const std::string& name) {
  const auto issued = read_file(folder + "/issued");
  if (!issued.ok()) return issued.status();
  const auto revoked = read_file(folder + "/revoked");
  if (!revoked.ok() && !absl::IsNotFound(revoked.status())) return revoked.status();
  const std::vector<std::string> known = absl::StrSplit(revoked.value_or(""), '\n');
  const std::vector<std::string> lines = absl::StrSplit(*issued, '\n');
  const std::string uri = identity_uri(role, name);
  std::string added;
  for (const std::string& line : lines) {
    const std::vector<std::string> words = absl::StrSplit(line, ' ');
    if (words.size() < 2 || words[1] != uri) continue;
    if (std::find(known.begin(), known.end(), line) != known.end()) continue;
    absl::StrAppend(&added, line, "\n");
  }
  if (added.empty()) {
    return absl::NotFoundError(
        absl::StrCat(folder, "/issued: no certificate of ", uri, " that is not revoked"));
  }
  return append_file(folder + "/revoked", added);
}

}  // namespace tessera::server
