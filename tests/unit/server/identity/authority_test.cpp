#include "server/identity/authority.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <ctime>
#include <fstream>

#include "server/identity/private_file.h"
#include "server/identity/revocations.h"
#include "server/identity/signed_certificate.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {
namespace {

class AuthorityTest : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(make_authority(folder_, year()).ok()); }

  static Validity year() {
    const std::int64_t now = std::time(nullptr);
    return {now - 60, now + 365 * 86'400};
  }
  std::string out(const std::string& name) const { return folder_ + "/" + name; }
  Identity issued_to(const std::string& name) const {
    return read_identity(read_file(out(name) + "/tls.crt").value()).value();
  }
  static unsigned mode_of(const std::string& path) {
    struct stat info {};
    return ::stat(path.c_str(), &info) == 0 ? info.st_mode & 0777u : 0;
  }

  ScratchFolder scratch_;
  const std::string folder_ = scratch_.path() + "/farm";
};

TEST_F(AuthorityTest, CertificateNamesRoleNameSerialAndExpiry) {
  const Validity validity = year();
  ASSERT_TRUE(issue(folder_, Role::worker, "rack-7", out("w"), validity).ok());
  const Identity identity = issued_to("w");
  EXPECT_EQ(identity.role, Role::worker);
  EXPECT_EQ(identity.name, "rack-7");
  EXPECT_GE(identity.serial.size(), 16u);
  EXPECT_EQ(identity.expires_s, validity.until_s);
  EXPECT_EQ(read_file(out("w") + "/ca.crt").value(), read_file(folder_ + "/ca.crt").value());
}

TEST_F(AuthorityTest, KeyFilesArePrivate) {
  ASSERT_TRUE(issue_server(folder_, {"localhost"}, year()).ok());
  ASSERT_TRUE(issue(folder_, Role::client, "ann", out("c"), year()).ok());
  for (const std::string key : {"/ca.key", "/tls.key", "/c/tls.key"}) {
    EXPECT_EQ(mode_of(folder_ + key), 0600u) << key;
  }
  EXPECT_EQ(mode_of(out("c")), 0700u);
}

TEST_F(AuthorityTest, RenewalKeepsAuthority) {
  ASSERT_TRUE(issue_server(folder_, {"a.example"}, year()).ok());
  const std::string authority = read_file(folder_ + "/ca.crt").value();
  const std::string server = read_file(folder_ + "/tls.crt").value();
  ASSERT_TRUE(make_authority(folder_, year()).ok());
  ASSERT_TRUE(issue_server(folder_, {"a.example", "10.0.0.7", "fe80::1"}, year()).ok());
  EXPECT_EQ(read_file(folder_ + "/ca.crt").value(), authority);
  EXPECT_NE(read_file(folder_ + "/tls.crt").value(), server);
}

TEST_F(AuthorityTest, AmbiguousNamesAreRejected) {
  for (const char* name : {"", ".", "../x", "a/b", "a b", "a,URI:tessera://admin/x", "a\nb",
                           "12345678901234567890123456789012345678901234567890123456789012345"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(issue(folder_, Role::client, name, out("x"), year())))
        << name;
  }
  for (const char* host : {"", "a,URI:tessera://admin/x", "a b", "a\nb", "DNS:x"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(issue_server(folder_, {host}, year()))) << host;
  }
  EXPECT_TRUE(absl::IsInvalidArgument(issue_server(folder_, {}, year())));
}

TEST_F(AuthorityTest, CertificateWithSeveralHoldersIsRefused) {
  const auto identity_of = [](const std::string& names) {
    const Extensions extensions{"critical,CA:FALSE", "critical,digitalSignature", nullptr, names};
    const auto pair = make_pair_signed("several", extensions, year(), nullptr);
    return read_identity(to_pem(pair->certificate.get()).value());
  };
  EXPECT_EQ(identity_of("URI:https://example.com/,URI:tessera://client/ann")->name, "ann");
  EXPECT_TRUE(absl::IsUnauthenticated(
      identity_of("URI:tessera://client/ann,URI:tessera://admin/bob").status()));
  EXPECT_TRUE(absl::IsUnauthenticated(identity_of("URI:https://example.com/").status()));
}

TEST_F(AuthorityTest, ExistingFilesAreNotOverwritten) {
  ASSERT_TRUE(issue(folder_, Role::client, "ann", out("c"), year()).ok());
  EXPECT_TRUE(absl::IsAlreadyExists(issue(folder_, Role::client, "bob", out("c"), year())));
  EXPECT_EQ(issued_to("c").name, "ann");
}

TEST_F(AuthorityTest, MissingAuthorityNamesInitCommand) {
  const absl::Status status = issue(folder_ + "/none", Role::client, "ann", out("c"), year());
  EXPECT_TRUE(absl::IsNotFound(status));
  EXPECT_NE(status.message().find("init-certs"), std::string::npos) << status;
}

TEST_F(AuthorityTest, RevokedNameCanBeReissued) {
  ASSERT_TRUE(issue(folder_, Role::client, "ann", out("one"), year()).ok());
  ASSERT_TRUE(issue(folder_, Role::client, "ann", out("two"), year()).ok());
  ASSERT_TRUE(issue(folder_, Role::client, "bob", out("bob"), year()).ok());
  ASSERT_TRUE(issue(folder_, Role::worker, "ann", out("worker"), year()).ok());
  EXPECT_TRUE(absl::IsNotFound(revoke(folder_, Role::client, "carl")));
  ASSERT_TRUE(revoke(folder_, Role::client, "ann").ok());
  EXPECT_TRUE(absl::IsNotFound(revoke(folder_, Role::client, "ann")))
      << "there is no second certificate";
  ASSERT_TRUE(issue(folder_, Role::client, "ann", out("three"), year()).ok());
  Revocations revocations(folder_ + "/revoked");
  EXPECT_TRUE(revocations.contains(issued_to("one").serial));
  EXPECT_TRUE(revocations.contains(issued_to("two").serial));
  for (const char* good : {"bob", "worker", "three"}) {
    EXPECT_FALSE(revocations.contains(issued_to(good).serial)) << good;
  }
}

TEST_F(AuthorityTest, MissingRevocationListRevokesNothing) {
  Revocations revocations(folder_ + "/revoked");
  EXPECT_FALSE(revocations.contains("ABC"));
  EXPECT_FALSE(revocations.contains(""));
}

TEST_F(AuthorityTest, CertificateWithoutRoleHasNoIdentity) {
  ASSERT_TRUE(issue_server(folder_, {"localhost"}, year()).ok());
  for (const char* file : {"/tls.crt", "/ca.crt"}) {
    EXPECT_TRUE(absl::IsUnauthenticated(read_identity(read_file(folder_ + file).value()).status()));
  }
  EXPECT_TRUE(absl::IsUnauthenticated(read_identity("no certificate").status()));
  EXPECT_TRUE(absl::IsUnauthenticated(read_identity("").status()));
}

}  // namespace
}  // namespace tessera::server
