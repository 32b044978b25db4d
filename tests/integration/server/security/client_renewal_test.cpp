// The client renews its certificate while it calls a farm, and survives the end of the old one.
#include <chrono>
#include <ctime>
#include <filesystem>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/api/farm_client.h"
#include "server/identity/private_file.h"
#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

namespace fs = std::filesystem;
using client::FarmClient;

class ClientRenewal : public SecureFarm {
 protected:
  /// Issues a certificate that is valid for some seconds, of which `past` have passed.
  void issue_brief(const std::string& name, int length, int past) const {
    fs::remove_all(certs_of(name));
    const std::int64_t now = std::time(nullptr);
    ASSERT_TRUE(
        issue(certs_, Role::client, name, certs_of(name), {now - past, now - past + length}).ok());
  }
  Identity identity_of(const std::string& name) const {
    return read_identity(read_file(certs_of(name) + "/tls.crt").value()).value();
  }
  std::unique_ptr<FarmClient> connect(const std::string& name) const {
    client::Connection connection;
    connection.server = server_->address();
    connection.certs = certs_of(name);
    return FarmClient::connect(connection).value();
  }
  /// Makes a call with a new client; returns its status and what it wrote to stderr.
  std::pair<absl::Status, std::string> call(const std::string& name) const {
    ::testing::internal::CaptureStderr();
    const absl::Status status = connect(name)->list_jobs({}).status();
    return {status, ::testing::internal::GetCapturedStderr()};
  }
};

TEST_F(ClientRenewal, ShortCommandRenewsDueCertificate) {
  issue_brief("old", 1000, 800);
  const Identity before = identity_of("old");
  const std::string key = read_file(certs_of("old") + "/tls.key").value();
  fs::permissions(certs_of("old") + "/tls.key", fs::perms(0640));
  fs::permissions(certs_of("old") + "/tls.crt", fs::perms(0600));
  const auto [status, warnings] = call("old");
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(warnings, "");
  const Identity after = identity_of("old");
  EXPECT_NE(after.serial, before.serial);
  EXPECT_EQ(after.name, "old");
  EXPECT_EQ(after.role, Role::client);
  EXPECT_GT(after.expires_s, before.expires_s + 600);
  EXPECT_NE(read_file(certs_of("old") + "/tls.key").value(), key);
  EXPECT_EQ(fs::status(certs_of("old") + "/tls.key").permissions(), fs::perms(0640));
  EXPECT_EQ(fs::status(certs_of("old") + "/tls.crt").permissions(), fs::perms(0600));
  EXPECT_TRUE(try_call("old").ok()) << "the pair matches";
}

TEST_F(ClientRenewal, CertificateThatIsNotDueIsKept) {
  issue_brief("young", 1000, 600);
  const std::string serial = identity_of("young").serial;
  EXPECT_EQ(call("young").second, "") << "no warning either, though it ends soon";
  EXPECT_EQ(identity_of("young").serial, serial);
}

TEST_F(ClientRenewal, WatchSurvivesCertificateEnd) {
  issue_brief("ann", 6, 0);
  const std::string job = create_job("ann", "shot");
  const std::int64_t end = identity_of("ann").expires_s;
  const auto client = connect("ann");
  std::thread waiting([&] {
    while (std::time(nullptr) <= end + 2)
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    EXPECT_TRUE(connect("ann")->cancel_job(job).ok());
  });
  const auto last =
      client->watch_job(job, std::chrono::milliseconds(100), [](const v1::Job&) { return true; });
  waiting.join();
  ASSERT_TRUE(last.ok()) << last.status();
  EXPECT_EQ(last->state(), v1::Job::STATE_CANCELLED);
  EXPECT_GT(identity_of("ann").expires_s, end);
}

TEST_F(ClientRenewal, FailureWarnsAndSaysWhatToDo) {
  issue_brief("old", 1000, 800);
  fs::rename(certs_ + "/ca.key", folder_ + "/ca.key");
  const std::string serial = identity_of("old").serial;
  const auto [status, warnings] = call("old");
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(identity_of("old").serial, serial);
  for (const char* part :
       {"warning: ", "/old/tls.crt: the certificate expires at ", "cannot be renewed: ", "without ",
        "tessera-server issue-cert CERTS --role client --name old"}) {
    EXPECT_NE(warnings.find(part), std::string::npos) << part << " in " << warnings;
  }
}

TEST_F(ClientRenewal, FailureLongBeforeExpiryIsSilent) {
  constexpr int kDay = 24 * 3600;
  issue_brief("old", 365 * kDay, 300 * kDay);
  fs::rename(certs_ + "/ca.key", folder_ + "/ca.key");
  const auto [status, warnings] = call("old");
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(warnings, "");
}

TEST_F(ClientRenewal, FailedWriteKeepsOldCertificate) {
  issue_brief("old", 1000, 800);
  const std::string serial = identity_of("old").serial;
  fs::create_directory(certs_of("old") + "/renewal.lock");  // no file can be opened there
  const auto [status, warnings] = call("old");
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(identity_of("old").serial, serial);
  EXPECT_NE(warnings.find("cannot be renewed: "), std::string::npos) << warnings;
  EXPECT_NE(warnings.find("renewal.lock"), std::string::npos) << warnings;
}

TEST_F(ClientRenewal, CertificateOfAnotherIssuerIsKept) {
  issue_brief("old", 1000, 800);
  fs::rename(certs_ + "/issued", folder_ + "/issued");
  ASSERT_TRUE(issue(certs_, Role::client, "other", certs_of("other"), year()).ok());
  const std::string serial = identity_of("old").serial;
  const auto [status, warnings] = call("old");
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(identity_of("old").serial, serial);
  EXPECT_NE(warnings.find("was not issued by this farm's authority"), std::string::npos)
      << warnings;
}

TEST_F(ClientRenewal, ExpiredOneIsNamedInTheError) {
  issue_brief("late", 1000, 1010);
  const absl::Status status = call("late").first;
  EXPECT_TRUE(absl::IsUnauthenticated(status)) << status;
  const std::string message(status.message());
  for (const char* part : {"/late/tls.crt: the certificate expired at 20", "UTC",
                           "tessera-server issue-cert CERTS --role client --name late"}) {
    EXPECT_NE(message.find(part), std::string::npos) << part << " in " << message;
  }
}

TEST_F(ClientRenewal, ConcurrentCommandsKeepPairMatching) {
  issue_brief("shared", 1000, 800);
  std::vector<std::thread> commands;
  for (int i = 0; i < 8; ++i) {
    commands.emplace_back([&] {
      const absl::Status status = connect("shared")->list_jobs({}).status();
      EXPECT_TRUE(status.ok()) << status;
    });
  }
  for (std::thread& command : commands) command.join();
  EXPECT_TRUE(try_call("shared").ok()) << "the pair matches";
  const std::string issued = read_file(certs_ + "/issued").value();
  int count = 0;
  for (std::size_t at = 0; (at = issued.find("/shared ", at)) != std::string::npos; ++at) ++count;
  EXPECT_EQ(count, 2) << "issued, and renewed once";
}

}  // namespace
}  // namespace tessera::server
