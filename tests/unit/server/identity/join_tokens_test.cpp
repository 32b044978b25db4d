#include "server/identity/join_tokens.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>

#include "server/identity/private_file.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {
namespace {

class JoinTokensTest : public testing::Test {
 protected:
  ScratchFolder scratch_;
  const std::string& folder_ = scratch_.path();
  const JoinTokens tokens_{folder_};
};

TEST_F(JoinTokensTest, TokenIsValidUntilItExpires) {
  const std::string text = tokens_.create(1000, 3).value();
  const auto token = tokens_.find(text, 999);
  ASSERT_TRUE(token.ok()) << token.status();
  EXPECT_EQ(token->max_joins, 3);
  EXPECT_EQ(token->id, text.substr(0, 8));
  EXPECT_TRUE(absl::IsUnauthenticated(tokens_.find(text, 1000).status()));
}

TEST_F(JoinTokensTest, StoreContainsNoSecret) {
  const std::string text = tokens_.create(1000, 0).value();
  const std::string path = folder_ + "/tokens/" + text.substr(0, 8);
  EXPECT_EQ(read_file(path).value().find(text.substr(9)), std::string::npos);
  struct stat info {};
  ASSERT_EQ(::stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777u, 0600u);
}

TEST_F(JoinTokensTest, MissingStoreIsNamed) {
  const auto token = JoinTokens(folder_ + "/elsewhere").create(1000, 0);
  EXPECT_TRUE(absl::IsNotFound(token.status())) << token.status();
  EXPECT_NE(token.status().message().find("/elsewhere: no store"), std::string::npos);
}

TEST_F(JoinTokensTest, PartialSecretIsRejected) {
  const std::string text = tokens_.create(1000, 0).value();
  const std::string other = tokens_.create(1000, 0).value();
  for (const std::string& wrong :
       {text.substr(0, 8), text.substr(0, 9), text.substr(0, text.size() - 1), text + "0",
        text.substr(9), text.substr(0, 8) + other.substr(8), std::string(), std::string(".")}) {
    EXPECT_TRUE(absl::IsUnauthenticated(tokens_.find(wrong, 0).status())) << wrong;
  }
}

TEST_F(JoinTokensTest, RevokedTokenIsInvalid) {
  const std::string text = tokens_.create(1000, 0).value();
  const std::string kept = tokens_.create(1000, 0).value();
  ASSERT_TRUE(tokens_.revoke(text.substr(0, 8)).ok());
  EXPECT_TRUE(absl::IsUnauthenticated(tokens_.find(text, 0).status()));
  EXPECT_TRUE(absl::IsNotFound(tokens_.revoke(text.substr(0, 8))));
  ASSERT_EQ(tokens_.list().value().size(), 1u);
  EXPECT_EQ(tokens_.list().value()[0].id, kept.substr(0, 8));
}

TEST_F(JoinTokensTest, IdCannotEscapeFolder) {
  ASSERT_TRUE(write_file(folder_ + "/precious", "sha256 x", 0600).ok());
  ASSERT_TRUE(tokens_.create(1000, 0).ok());
  for (const char* id : {"../precious", "..", ".", "", "/etc/passwd", "0123456789", "ABCDEF01"}) {
    EXPECT_TRUE(absl::IsNotFound(tokens_.revoke(id))) << id;
    EXPECT_TRUE(absl::IsUnauthenticated(tokens_.find(std::string(id) + ".x", 0).status())) << id;
  }
  EXPECT_TRUE(std::filesystem::exists(folder_ + "/precious"));
}

TEST_F(JoinTokensTest, EmptyStoreHasNoTokens) {
  EXPECT_TRUE(tokens_.list().value().empty());
  EXPECT_TRUE(absl::IsUnauthenticated(tokens_.find("01234567.x", 0).status()));
}

}  // namespace
}  // namespace tessera::server
