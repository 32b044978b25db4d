#include "rpc/certificates/certificate_files.h"

#include <fcntl.h>
#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <fstream>
#include <iterator>

#include "absl/strings/str_cat.h"

namespace tessera::contract {
namespace {

using Bio = std::unique_ptr<BIO, decltype(&BIO_free)>;
using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;
using Certificate = std::unique_ptr<X509, decltype(&X509_free)>;

constexpr char kRenewed[] = "/tls.renewed";
constexpr char kBegin[] = "-----BEGIN CERTIFICATE-----";

std::string text_of(const Bio& bio) {
  char* bytes = nullptr;
  const long size = BIO_get_mem_data(bio.get(), &bytes);
  return {bytes, static_cast<std::size_t>(size)};
}

Bio open_text(std::string_view text) {
  return {BIO_new_mem_buf(text.data(), static_cast<int>(text.size())), &BIO_free};
}

Certificate read_certificate(std::string_view pem) {
  return {PEM_read_bio_X509(open_text(pem).get(), nullptr, nullptr, nullptr), &X509_free};
}

absl::StatusOr<std::string> read_text(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return absl::NotFoundError(absl::StrCat(path, ": cannot read the file"));
  return std::string(std::istreambuf_iterator<char>(file), {});
}

/// Gives a file that nobody has opened yet the owner and the mode of the one that it replaces.
bool copy_owner_and_mode(const std::string& replaced, int file) {
  struct stat old {};
  if (::stat(replaced.c_str(), &old) != 0) return true;  // there is none
  struct stat now {};
  if (::fstat(file, &now) != 0) return false;
  const bool has_owner = now.st_uid == old.st_uid && now.st_gid == old.st_gid;
  return (has_owner || ::fchown(file, old.st_uid, old.st_gid) == 0) &&
         ::fchmod(file, old.st_mode & (S_IRWXU | S_IRWXG | S_IRWXO)) == 0;
}

/// Writes `path`.part and syncs it. It has the owner and the mode of `path`, or `mode` if there is
/// no such file.
absl::Status write_part(const std::string& path, std::string_view text, mode_t mode) {
  const std::string part = path + ".part";
  ::unlink(part.c_str());
  const int file = ::open(part.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  if (file < 0) return absl::ErrnoToStatus(errno, part);
  const bool is_written =
      copy_owner_and_mode(path, file) &&
      ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
      ::fsync(file) == 0;
  absl::Status status = is_written ? absl::OkStatus() : absl::ErrnoToStatus(errno, part);
  ::close(file);
  return status;
}

/// Moves `path`.part to `path`.
absl::Status move_part(const std::string& path) {
  return std::rename((path + ".part").c_str(), path.c_str()) == 0
             ? absl::OkStatus()
             : absl::ErrnoToStatus(errno, path);
}

absl::Status sync_folder(const std::string& folder) {
  const int opened = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (opened < 0) return absl::ErrnoToStatus(errno, folder);
  absl::Status status =
      ::fsync(opened) == 0 ? absl::OkStatus() : absl::ErrnoToStatus(errno, folder);
  ::close(opened);
  return status;
}

/// Writes both files beside their places, then moves both, so that a reader sees a key without its
/// certificate for microseconds only.
absl::Status place(const std::string& folder, std::string_view key, std::string_view certificate) {
  const std::string key_path = folder + "/tls.key", certificate_path = folder + "/tls.crt";
  absl::Status status = write_part(key_path, key, 0600);
  if (status.ok()) status = write_part(certificate_path, certificate, 0644);
  if (status.ok()) status = move_part(key_path);
  if (status.ok()) status = move_part(certificate_path);
  if (status.ok()) status = sync_folder(folder);
  return status;
}

}  // namespace

absl::StatusOr<NewKey> make_key() {
  const Key key(EVP_EC_gen("P-256"), &EVP_PKEY_free);
  const std::unique_ptr<X509_REQ, decltype(&X509_REQ_free)> request(X509_REQ_new(), &X509_REQ_free);
  const Bio key_text(BIO_new(BIO_s_mem()), &BIO_free),
      request_text(BIO_new(BIO_s_mem()), &BIO_free);
  const bool ok = key && request && X509_REQ_set_pubkey(request.get(), key.get()) == 1 &&
                  X509_REQ_sign(request.get(), key.get(), EVP_sha256()) != 0 &&
                  PEM_write_bio_X509_REQ(request_text.get(), request.get()) == 1 &&
                  PEM_write_bio_PKCS8PrivateKey(key_text.get(), key.get(), nullptr, nullptr, 0,
                                                nullptr, nullptr) == 1;
  if (!ok) return absl::InternalError("OpenSSL cannot create a key");
  return NewKey{text_of(key_text), text_of(request_text)};
}

absl::StatusOr<WallTime> renewal_time(const std::string& folder) {
  const std::string path = folder + "/tls.crt";
  const auto end = certificate_end(path);
  if (!end.ok()) return end.status();
  const auto begin = certificate_begin(path);
  if (!begin.ok()) return begin.status();
  return *begin + (*end - *begin) / 3 * 2;
}

absl::StatusOr<std::unique_ptr<CertificateLock>> CertificateLock::take(const std::string& folder) {
  const std::string path = folder + "/renewal.lock";
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (file < 0) return absl::ErrnoToStatus(errno, path);
  if (::flock(file, LOCK_EX | LOCK_NB) != 0) {
    ::close(file);
    return absl::UnavailableError(absl::StrCat(path, ": another process renews the certificate"));
  }
  return std::unique_ptr<CertificateLock>(new CertificateLock(file));
}

CertificateLock::~CertificateLock() {
  ::close(file_);
}

absl::Status install_certificate(const std::string& folder, std::string_view key,
                                 std::string_view certificate) {
  const Certificate parsed = read_certificate(certificate);
  const Key parsed_key(PEM_read_bio_PrivateKey(open_text(key).get(), nullptr, nullptr, nullptr),
                       &EVP_PKEY_free);
  if (!parsed || !parsed_key || X509_check_private_key(parsed.get(), parsed_key.get()) != 1) {
    return absl::InvalidArgumentError("the server's answer is no certificate for the new key");
  }
  const std::string both = absl::StrCat(std::string(key), std::string(certificate));
  const std::string path = folder + kRenewed;
  absl::Status status = write_part(path, both, 0600);
  if (status.ok()) status = move_part(path);
  if (status.ok()) status = sync_folder(folder);
  return status.ok() ? finish_install(folder) : status;
}

absl::Status finish_install(const std::string& folder) {
  const std::string path = folder + kRenewed;
  if (::access(path.c_str(), F_OK) != 0) return absl::OkStatus();
  const auto both = read_text(path);
  if (!both.ok()) return both.status();
  const std::size_t middle = both->find(kBegin);
  if (middle == std::string::npos) {
    return absl::DataLossError(absl::StrCat(path, ": contains no certificate; delete the file"));
  }
  absl::Status status = place(folder, both->substr(0, middle), both->substr(middle));
  if (!status.ok()) return status;
  ::unlink(path.c_str());
  return sync_folder(folder);
}

void repair_install(const std::string& folder) {
  if (::access((folder + kRenewed).c_str(), F_OK) != 0) return;
  const auto lock = CertificateLock::take(folder);
  if (lock.ok()) finish_install(folder).IgnoreError();
}

}  // namespace tessera::contract
