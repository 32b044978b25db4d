// A worker joins, reconnects and is refused.
#include <chrono>
#include <thread>

#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;

using JoiningTest = SecureFarm;

TEST_F(JoiningTest, WorkerNeedsValidToken) {
  EXPECT_EQ(join("w1", "one", "").error_code(), StatusCode::UNAUTHENTICATED);
  EXPECT_EQ(join("w1", "one", "01234567.0123").error_code(), StatusCode::UNAUTHENTICATED);
  EXPECT_EQ(join("w1", "one", "../../x.y").error_code(), StatusCode::UNAUTHENTICATED);
  EXPECT_EQ(join("w1", "one", token(-1)).error_code(), StatusCode::UNAUTHENTICATED) << "expired";
  const std::string revoked = token();
  ASSERT_TRUE(JoinTokens(store_).revoke(revoked.substr(0, 8)).ok());
  EXPECT_EQ(join("w1", "one", revoked).error_code(), StatusCode::UNAUTHENTICATED);
  EXPECT_TRUE(join("w1", "one", token()).ok());
}

TEST_F(JoiningTest, TokenAdmitsLimitedWorkersRepeatedly) {
  const std::string two = token(3600, 2);
  EXPECT_TRUE(join("w1", "one", two).ok());
  EXPECT_TRUE(join("w1", "two", two).ok());
  EXPECT_EQ(join("w1", "three", two).error_code(), StatusCode::PERMISSION_DENIED);
  EXPECT_TRUE(join("w1", "one", two).ok()) << "restarted with the same token";
  server_.reset();
  running_.reset();  // only one process may hold the store
  running_ = std::make_unique<RunningCoordinator>(store_);
  server_ = start_server(certs_).value();
  EXPECT_EQ(join("w1", "three", two).error_code(), StatusCode::PERMISSION_DENIED)
      << "the store remembers the joins";
}

TEST_F(JoiningTest, SessionKeyOutlivesToken) {
  const std::string once = token(3600, 1);
  const auto joined = worker("w1", "one", once);
  ASSERT_TRUE(joined->open());
  ASSERT_TRUE(JoinTokens(store_).revoke(once.substr(0, 8)).ok());
  const std::string key = joined->session_key;
  EXPECT_EQ(key.size(), 64u);
  EXPECT_TRUE(join("w1", "one", key).ok());
  EXPECT_EQ(join("w1", "two", key).error_code(), StatusCode::UNAUTHENTICATED) << "another worker";
  EXPECT_EQ(join("w2", "one", key).error_code(), StatusCode::UNAUTHENTICATED)
      << "another certificate";
}

TEST_F(JoiningTest, WorkerIdIsBoundToCertificate) {
  const std::string text = token();
  EXPECT_TRUE(join("w1", "one", text).ok());
  EXPECT_EQ(join("w2", "one", text).error_code(), StatusCode::PERMISSION_DENIED);
}

TEST_F(JoiningTest, NonWorkerCertificateCannotJoin) {
  EXPECT_EQ(join("root", "one", "").error_code(), StatusCode::UNAUTHENTICATED);
  EXPECT_EQ(join("ann", "one", token()).error_code(), StatusCode::PERMISSION_DENIED);
}

TEST_F(JoiningTest, RevocationEndsWorkStream) {
  const auto joined = worker("w1", "one", token());
  ASSERT_TRUE(joined->open());
  ASSERT_TRUE(revoke(certs_, Role::worker, "w1").ok());
  std::thread beats([&] {  // heartbeats once a second, like a worker
    for (int i = 0; i < 30; ++i) {
      joined->grant(1);
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  });
  TestWorker::Unit unit;
  EXPECT_FALSE(joined->next(unit)) << "the stream has ended";
  beats.join();
  EXPECT_EQ(joined->close().error_code(), StatusCode::UNAUTHENTICATED);
}

TEST_F(JoiningTest, SecretsAreNotLogged) {
  const std::string text = token();
  create_job("ann", "shot");
  const auto joined = worker("w1", "one", text);
  ASSERT_TRUE(joined->open());
  EXPECT_EQ(joined->work(), 18);
  join("w2", "one", text);
  join("w2", "two", text + "0");
  const std::string written = log();
  EXPECT_NE(written.find("worker one connected"), std::string::npos) << "the log is not empty";
  for (const std::string& secret : {text.substr(9), joined->session_key}) {
    EXPECT_EQ(written.find(secret), std::string::npos);
  }
}

}  // namespace
}  // namespace tessera::server
