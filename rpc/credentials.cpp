#include "rpc/credentials.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "rpc/certificates/certificate_files.h"

namespace tessera::contract {
namespace {

namespace tls = grpc::experimental;

constexpr unsigned kWatchSeconds = 1;

absl::StatusOr<std::shared_ptr<tls::CertificateProviderInterface>> watch(
    const std::string& folder) {
  repair_install(folder);
  const std::string key = folder + "/tls.key", certificate = folder + "/tls.crt",
                    authority = folder + "/ca.crt";
  for (const std::string& path : {key, certificate, authority}) {
    if (::access(path.c_str(), R_OK) == 0) continue;
    return absl::ErrnoToStatus(
        errno, absl::StrCat(path,
                            " (create certificates with `tessera-server init-certs` "
                            "and `issue-cert`)"));
  }
  struct stat info {};
  if (::stat(key.c_str(), &info) != 0 || (info.st_mode & S_IRWXO) != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat(key, " is readable by every user; set its mode to 0600"));
  }
  return std::make_shared<tls::FileWatcherCertificateProvider>(key, certificate, authority,
                                                               kWatchSeconds);
}

}  // namespace

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> channel_credentials(
    const std::string& folder) {
  auto provider = watch(folder);
  if (!provider.ok()) return provider.status();
  tls::TlsChannelCredentialsOptions options;
  options.set_certificate_provider(*std::move(provider));
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  return tls::TlsCredentials(options);
}

absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> server_credentials(
    const std::string& folder) {
  auto provider = watch(folder);
  if (!provider.ok()) return provider.status();
  tls::TlsServerCredentialsOptions options(*std::move(provider));
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  return tls::TlsServerCredentials(options);
}

}  // namespace tessera::contract
