// Access to the server, with real sockets and real certificates.
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include <chrono>
#include <ctime>
#include <filesystem>
#include <thread>

#include "rpc/certificates/certificate_dates.h"
#include "server/identity/private_file.h"
#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;

using CertificatesTest = SecureFarm;

TEST_F(CertificatesTest, EveryRoleCanConnect) {
  EXPECT_TRUE(try_call("ann").ok());
  EXPECT_TRUE(try_call("root").ok());
  EXPECT_EQ(try_call("w1").error_code(), StatusCode::PERMISSION_DENIED)
      << "connected, but not permitted as a client";
}

TEST_F(CertificatesTest, MissingCertificateIsRefused) {
  grpc::experimental::TlsChannelCredentialsOptions options;
  options.set_certificate_provider(
      std::make_shared<grpc::experimental::StaticDataCertificateProvider>(
          read_file(certs_ + "/ca.crt").value()));
  options.watch_root_certs();
  const auto anonymous =
      grpc::CreateChannel(server_->address(), grpc::experimental::TlsCredentials(options));
  EXPECT_EQ(try_call(anonymous).error_code(), StatusCode::UNAVAILABLE);
  const auto plain = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
  EXPECT_EQ(try_call(plain).error_code(), StatusCode::UNAVAILABLE);
}

TEST_F(CertificatesTest, ForeignAuthorityIsRefused) {
  const std::string other = folder_ + "/other";
  ASSERT_TRUE(make_authority(other, year()).ok());
  ASSERT_TRUE(issue(other, Role::admin, "root", folder_ + "/stranger", year()).ok());
  EXPECT_EQ(try_call("stranger").error_code(), StatusCode::UNAVAILABLE)
      << "the client must reject the server";
  ASSERT_TRUE(
      write_file(folder_ + "/stranger/ca.crt", read_file(certs_ + "/ca.crt").value(), 0644).ok());
  EXPECT_EQ(try_call("stranger").error_code(), StatusCode::UNAVAILABLE)
      << "the server must reject the client";
}

TEST_F(CertificatesTest, ValidityPeriodIsEnforced) {
  const std::int64_t now = std::time(nullptr);
  ASSERT_TRUE(issue(certs_, Role::client, "ann", certs_of("late"), {now - 7200, now - 3600}).ok());
  ASSERT_TRUE(issue(certs_, Role::client, "ann", certs_of("early"), {now + 3600, now + 7200}).ok());
  EXPECT_EQ(try_call("late").error_code(), StatusCode::UNAVAILABLE);
  EXPECT_EQ(try_call("early").error_code(), StatusCode::UNAVAILABLE);
}

TEST_F(CertificatesTest, ExpiryEndsOpenConnections) {
  const std::int64_t now = std::time(nullptr);
  ASSERT_TRUE(issue(certs_, Role::client, "ann", certs_of("brief"), {now - 60, now + 8}).ok());
  const auto open = channel("brief");
  ASSERT_TRUE(try_call(open).ok());
  grpc::Status answer;
  while (std::time(nullptr) < now + 30 && answer.ok()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    answer = try_call(open);
  }
  EXPECT_EQ(answer.error_code(), StatusCode::UNAUTHENTICATED);
}

TEST_F(CertificatesTest, ClientChecksServerName) {
  ASSERT_TRUE(issue_server(certs_, {"elsewhere.example"}, year()).ok());
  const auto server = start_server(certs_);
  ASSERT_TRUE(server.ok());
  const auto to = contract::open_channel((*server)->address(), certs_of("ann")).value();
  EXPECT_EQ(try_call(to).error_code(), StatusCode::UNAVAILABLE);
}

TEST_F(CertificatesTest, WorkerCertificateCannotServe) {
  const auto impostor = start_server(certs_of("w1"));
  ASSERT_TRUE(impostor.ok());
  const auto to = contract::open_channel((*impostor)->address(), certs_of("ann")).value();
  EXPECT_EQ(try_call(to).error_code(), StatusCode::UNAVAILABLE);
}

TEST_F(CertificatesTest, RenewalNeedsNoRestart) {
  ASSERT_TRUE(issue_server(certs_, {"elsewhere.example"}, year()).ok());
  const auto server = start_server(certs_);
  ASSERT_TRUE(server.ok());
  const auto try_new_connection = [&] {
    return try_call(contract::open_channel((*server)->address(), certs_of("ann")).value());
  };
  ASSERT_EQ(try_new_connection().error_code(), StatusCode::UNAVAILABLE);
  ASSERT_TRUE(issue_server(certs_, {"127.0.0.1"}, year()).ok());
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  grpc::Status status;
  do {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    status = try_new_connection();
  } while (!status.ok() && std::chrono::steady_clock::now() < limit);
  EXPECT_TRUE(status.ok()) << status.error_message();
}

TEST_F(CertificatesTest, EndOfCertificateIsAnnounced) {
  const std::int64_t now = std::time(nullptr), day = 86'400;
  const auto at = [](std::int64_t time_s) {
    return std::chrono::system_clock::from_time_t(static_cast<std::time_t>(time_s));
  };
  ASSERT_TRUE(issue(certs_, Role::worker, "w1", certs_of("soon"), {now - 60, now + 30 * day}).ok());
  const std::string folder = certs_of("soon");
  EXPECT_EQ(contract::certificate_end(folder + "/tls.crt").value(), at(now + 30 * day));
  EXPECT_EQ(contract::expiry_warning(folder, at(now)), "");
  EXPECT_NE(contract::expiry_warning(folder, at(now + 10 * day)).find("soon/tls.crt"),
            std::string::npos);
  EXPECT_NE(contract::expiry_warning(folder, at(now + 31 * day)).find("expired at"),
            std::string::npos);
  EXPECT_EQ(contract::expiry_warning("", at(now)), "");
}

TEST_F(CertificatesTest, EndedCertificateExplainsRefusal) {
  const std::int64_t now = std::time(nullptr);
  const auto at = [](std::int64_t time_s) {
    return std::chrono::system_clock::from_time_t(static_cast<std::time_t>(time_s));
  };
  const std::string folder = certs_of("brief");
  ASSERT_TRUE(issue(certs_, Role::worker, "w1", folder, {now - 60, now + 100}).ok());
  contract::CertificateRenewal renewal(folder);
  EXPECT_FALSE(renewal.explains_refusal(at(now))) << "it may be revoked";
  EXPECT_TRUE(renewal.explains_refusal(at(now + 101)));
  ASSERT_TRUE(issue(certs_, Role::worker, "w1", certs_of("new"), year()).ok());
  std::filesystem::copy_file(certs_of("new") + "/tls.crt", folder + "/tls.crt",
                             std::filesystem::copy_options::overwrite_existing);
  EXPECT_TRUE(renewal.explains_refusal(at(now + 200))) << "the old connection may still be used";
  EXPECT_FALSE(renewal.explains_refusal(at(now + 200 + 16 * 60))) << "the new one is refused";
  EXPECT_FALSE(contract::CertificateRenewal("").explains_refusal(at(now)));
}

TEST_F(CertificatesTest, RevokedNameCanBeReissued) {
  const auto open = channel("ann");
  ASSERT_TRUE(try_call(open).ok());
  ASSERT_TRUE(revoke(certs_, Role::client, "ann").ok());
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));  // the list is read every second
  EXPECT_EQ(try_call(open).error_code(), StatusCode::UNAUTHENTICATED) << "on the open connection";
  EXPECT_EQ(try_call("ann").error_code(), StatusCode::UNAUTHENTICATED) << "on a new one";
  EXPECT_TRUE(try_call("bob").ok());
  ASSERT_TRUE(issue(certs_, Role::client, "ann", certs_of("again"), year()).ok());
  EXPECT_TRUE(try_call("again").ok());
}

TEST_F(CertificatesTest, ServerNamesMissingFiles) {
  const absl::Status none = start_server(folder_ + "/none").status();
  EXPECT_TRUE(absl::IsNotFound(none));
  EXPECT_NE(none.message().find("/none/tls.key"), std::string::npos) << none;
  std::filesystem::permissions(certs_ + "/tls.key", std::filesystem::perms::others_read,
                               std::filesystem::perm_options::add);
  EXPECT_TRUE(absl::IsPermissionDenied(start_server(certs_).status()));
}

}  // namespace
}  // namespace tessera::server
