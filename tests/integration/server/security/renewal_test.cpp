// Certificates are renewed while they are in use, through the server.
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rsa.h>
#include <openssl/x509.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>

#include "rpc/certificate_renewer.h"
#include "rpc/certificates/certificate_files.h"
#include "server/identity/private_file.h"
#include "server/identity/revocations.h"
#include "tessera/v1/certificate_service.grpc.pb.h"
#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;
using std::chrono::milliseconds;
using std::chrono::seconds;

class RenewalTest : public SecureFarm {
 protected:
  /// Issues a certificate that is valid for some seconds, of which `past` have passed.
  void issue_brief(Role role, const std::string& name, int length, int past = 0) const {
    std::filesystem::remove_all(certs_of(name));
    const std::int64_t now = std::time(nullptr);
    ASSERT_TRUE(issue(certs_, role, name, certs_of(name), {now - past, now - past + length}).ok());
  }
  Identity identity_of(const std::string& name) const {
    return read_identity(read_file(certs_of(name) + "/tls.crt").value()).value();
  }
  std::string key_of(const std::string& name) const {
    return read_file(certs_of(name) + "/tls.key").value();
  }
  grpc::Status renew_for(const std::string& name, const std::string& signing_request,
                         std::string* certificate = nullptr) const {
    grpc::ClientContext context;
    prepare(context);
    v1::RenewCertificateRequest request;
    request.set_signing_request(signing_request);
    v1::RenewCertificateResponse response;
    const auto stub = v1::CertificateService::NewStub(channel(name));
    grpc::Status status = stub->RenewCertificate(&context, request, &response);
    if (certificate != nullptr) *certificate = response.certificate();
    return status;
  }
  static std::string request_for(EVP_PKEY* key) {
    X509_REQ* request = X509_REQ_new();
    X509_REQ_set_pubkey(request, key);
    X509_REQ_sign(request, key, EVP_sha256());
    BIO* text = BIO_new(BIO_s_mem());
    PEM_write_bio_X509_REQ(text, request);
    char* bytes = nullptr;
    const long size = BIO_get_mem_data(text, &bytes);
    std::string pem(bytes, static_cast<std::size_t>(size));
    BIO_free(text);
    X509_REQ_free(request);
    EVP_PKEY_free(key);
    return pem;
  }
};

TEST_F(RenewalTest, CertificateOfSecondsIsRenewedInTime) {
  issue_brief(Role::worker, "brief", 9);
  const Identity before = identity_of("brief");
  const std::string old_key = key_of("brief");
  std::atomic<int> renewals = 0;
  contract::CertificateRenewer::Options options;
  options.folder = certs_of("brief");
  options.channel = [this] { return channel("brief"); };
  options.renewed = [&] { ++renewals; };
  options.failed = [](const absl::Status& status) { ADD_FAILURE() << status; };
  const contract::CertificateRenewer renewer(std::move(options));
  while (std::time(nullptr) <= before.expires_s + 1) {
    std::this_thread::sleep_for(milliseconds(200));
    EXPECT_EQ(try_call("brief").error_code(), StatusCode::PERMISSION_DENIED)
        << "connected, but not permitted as a client";
  }
  EXPECT_GE(renewals, 1);
  const Identity after = identity_of("brief");
  EXPECT_EQ(after.role, Role::worker);
  EXPECT_EQ(after.name, "brief");
  EXPECT_NE(after.serial, before.serial);
  EXPECT_GT(after.expires_s, before.expires_s + 3);
  EXPECT_NE(key_of("brief"), old_key) << "it has a new key";
  EXPECT_EQ(std::filesystem::status(certs_of("brief") + "/tls.key").permissions(),
            std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  EXPECT_NE(read_file(certs_ + "/issued")->find(after.serial), std::string::npos);
}

TEST_F(RenewalTest, ServerRenewsItself) {
  const std::int64_t now = std::time(nullptr);
  ASSERT_TRUE(issue_server(certs_, {"127.0.0.1", "farm.example"}, {now, now + 9}).ok());
  server_ = start_server(certs_).value();
  ASSERT_TRUE(try_call("ann").ok());
  const auto expiry_s = [&] {
    const auto families = running_->coordinator().farm().metrics().certificate_expiry.Collect();
    return families.empty() ? 0 : families.front().metric.front().gauge.value;
  };
  EXPECT_EQ(expiry_s(), static_cast<double>(now + 9));
  while (std::time(nullptr) <= now + 11) std::this_thread::sleep_for(milliseconds(200));
  EXPECT_GT(expiry_s(), static_cast<double>(now + 11));
  EXPECT_TRUE(try_call("ann").ok()) << "a new connection, after the first certificate has expired";
}

TEST_F(RenewalTest, FreshCertificateIsNotRenewed) {
  const grpc::Status status = renew_for("w1", contract::make_key()->signing_request);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_NE(status.error_message().find("half of its validity"), std::string::npos);
}

TEST_F(RenewalTest, EveryRoleKeepsItsRoleAndName) {
  for (const Role role : {Role::client, Role::worker, Role::admin}) {
    issue_brief(role, "old", 1000, 800);
    std::string certificate;
    const grpc::Status status =
        renew_for("old", contract::make_key()->signing_request, &certificate);
    ASSERT_TRUE(status.ok()) << status.error_message();
    const auto renewed = read_identity(certificate);
    ASSERT_TRUE(renewed.ok()) << renewed.status();
    EXPECT_EQ(renewed->role, role);
    EXPECT_EQ(renewed->name, "old");
    EXPECT_NEAR(static_cast<double>(renewed->expires_s), std::time(nullptr) + 900.0, 5);
  }
}

TEST_F(RenewalTest, AuthorityElsewhereSaysWhatToDo) {
  issue_brief(Role::worker, "old", 1000, 800);
  std::filesystem::rename(certs_ + "/ca.key", folder_ + "/ca.key");
  const grpc::Status status = renew_for("old", contract::make_key()->signing_request);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_NE(status.error_message().find("issue-cert"), std::string::npos) << status.error_message();
}

TEST_F(RenewalTest, MalformedRequestsAreRefused) {
  issue_brief(Role::worker, "old", 1000, 800);
  std::string forged = contract::make_key()->signing_request;
  const std::size_t at = forged.size() / 2;
  forged[at] = forged[at] == 'A' ? 'B' : 'A';
  for (const std::string& request :
       {std::string(), std::string("no request"), forged, request_for(EVP_EC_gen("P-384")),
        request_for(EVP_RSA_gen(2048)), std::string(20'000, 'x'),
        read_file(certs_ + "/tls.crt").value()}) {
    EXPECT_EQ(renew_for("old", request).error_code(), StatusCode::INVALID_ARGUMENT)
        << request.substr(0, 40);
  }
}

TEST_F(RenewalTest, RevokedHolderGetsNoCertificate) {
  issue_brief(Role::client, "old", 1000, 800);
  const Identity present = identity_of("old");
  ASSERT_TRUE(revoke(certs_, Role::client, "old").ok());
  const auto renewed =
      renew(certs_, present, contract::make_key()->signing_request, std::time(nullptr));
  EXPECT_TRUE(absl::IsUnauthenticated(renewed.status())) << renewed.status();
}

TEST_F(RenewalTest, RevocationIncludesRenewedOnes) {
  issue_brief(Role::client, "old", 1000, 800);
  std::string certificate;
  ASSERT_TRUE(renew_for("old", contract::make_key()->signing_request, &certificate).ok());
  ASSERT_TRUE(revoke(certs_, Role::client, "old").ok());
  Revocations revocations(certs_ + "/revoked");
  EXPECT_TRUE(revocations.contains(read_identity(certificate)->serial));
  EXPECT_TRUE(revocations.contains(identity_of("old").serial));
}

TEST_F(RenewalTest, InterruptedInstallationIsCompleted) {
  issue_brief(Role::client, "old", 1000, 800);
  const auto key = contract::make_key();
  std::string certificate;
  ASSERT_TRUE(renew_for("old", key->signing_request, &certificate).ok());
  const std::string folder = certs_of("old");
  // Stopped after the first of two files was replaced.
  std::ofstream(folder + "/tls.renewed") << key->key << certificate;
  std::ofstream(folder + "/tls.key") << key->key;
  EXPECT_TRUE(try_call("old").ok());
  EXPECT_EQ(read_file(folder + "/tls.crt").value(), certificate);
  EXPECT_FALSE(std::filesystem::exists(folder + "/tls.renewed"));
}

TEST_F(RenewalTest, SharedDirectoryIsRenewedOnce) {
  issue_brief(Role::worker, "shared", 1000, 800);
  const auto open = channel("shared");
  std::vector<std::thread> processes;
  std::atomic<int> done = 0;
  for (int i = 0; i < 8; ++i) {
    processes.emplace_back([&] {
      while (true) {
        grpc::ClientContext context;
        const auto renewed = contract::renew_certificate(open, certs_of("shared"), context);
        if (!absl::IsUnavailable(renewed.status())) {
          EXPECT_TRUE(renewed.ok()) << renewed.status();
          ++done;
          return;
        }
        std::this_thread::sleep_for(milliseconds(5));
      }
    });
  }
  for (std::thread& process : processes) process.join();
  EXPECT_EQ(done, 8);
  EXPECT_EQ(try_call("shared").error_code(), StatusCode::PERMISSION_DENIED) << "the pair matches";
  const std::string issued = read_file(certs_ + "/issued").value();
  int count = 0;
  for (std::size_t at = 0; (at = issued.find("/shared ", at)) != std::string::npos; ++at) ++count;
  EXPECT_EQ(count, 2) << "issued, and renewed once";
}

TEST_F(RenewalTest, ForeignCertificateIsNotInstalled) {
  const auto key = contract::make_key();
  const std::string certificate = read_file(certs_of("ann") + "/tls.crt").value();
  EXPECT_TRUE(absl::IsInvalidArgument(
      contract::install_certificate(certs_of("ann"), key->key, certificate)));
  EXPECT_TRUE(try_call("ann").ok());
}

}  // namespace
}  // namespace tessera::server
