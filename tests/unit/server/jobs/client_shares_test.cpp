// Weights of clients in fair share that operators set, over restarts.
#include <string>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class ClientSharesTest : public CoordinatorFixture {
 protected:
  absl::StatusOr<ShareView> set(const std::string& client, double weight) {
    absl::StatusOr<ShareView> result = absl::UnknownError("no answer");
    coordinator->shares().set(client, weight, [&](const auto& share) { result = share; });
    pump();
    return result;
  }
  absl::StatusOr<ShareView> reset(const std::string& client) {
    absl::StatusOr<ShareView> result = absl::UnknownError("no answer");
    coordinator->shares().reset(client, [&](const auto& share) { result = share; });
    pump();
    return result;
  }
  /// The client's weight and its source in the list; "" if it is not in it.
  std::string listed(const std::string& client) {
    const auto shares = coordinator->shares().list(client);
    if (shares.empty()) return "";
    const char* const sources[] = {"", "default", "option", "set"};
    return std::to_string(shares.at(0).weight) + " " +
           sources[static_cast<std::size_t>(shares.at(0).source)];
  }
};

TEST_F(ClientSharesTest, SetWeightWinsAndOutlivesRestart) {
  options.policy.share.weights = {{"ann", 2.0}};
  start();
  EXPECT_EQ(listed("ann"), "2.000000 option");
  EXPECT_EQ(listed("ben"), "");
  ASSERT_TRUE(set("ann", 3).ok());
  ASSERT_TRUE(set("ben", 0.5).ok());
  EXPECT_EQ(listed("ann"), "3.000000 set");
  start();
  EXPECT_EQ(listed("ann"), "3.000000 set");
  EXPECT_EQ(listed("ben"), "0.500000 set");
  EXPECT_EQ(coordinator->shares().list("").size(), 2u);
}

TEST_F(ClientSharesTest, ResetReturnsToOptionElseToOne) {
  options.policy.share.weights = {{"ann", 2.0}};
  start();
  ASSERT_TRUE(set("ann", 3).ok());
  ASSERT_TRUE(set("ben", 3).ok());
  const auto of_ann = reset("ann"), of_ben = reset("ben");
  ASSERT_TRUE(of_ann.ok() && of_ben.ok());
  EXPECT_EQ(of_ann->weight, 2);
  EXPECT_EQ(of_ann->source, ShareSource::option);
  EXPECT_EQ(of_ben->weight, 1);
  EXPECT_EQ(of_ben->source, ShareSource::by_default);
  EXPECT_TRUE(absl::IsNotFound(reset("ann").status()));
  start();
  EXPECT_EQ(listed("ann"), "2.000000 option");
  EXPECT_EQ(listed("ben"), "");
}

TEST_F(ClientSharesTest, WeightThatIsNotWrittenHasNoEffect) {
  ASSERT_TRUE(set("ann", 3).ok());
  store.controls().fail_commits_with(absl::ResourceExhaustedError("full"));
  EXPECT_TRUE(absl::IsResourceExhausted(set("ann", 5).status()));
  EXPECT_TRUE(absl::IsResourceExhausted(set("ben", 5).status()));
  EXPECT_TRUE(absl::IsResourceExhausted(reset("ann").status()));
  EXPECT_EQ(listed("ann"), "3.000000 set");
  EXPECT_EQ(listed("ben"), "");
  store.controls().fail_commits_with(absl::OkStatus());
  start();
  EXPECT_EQ(listed("ann"), "3.000000 set");
  EXPECT_EQ(listed("ben"), "");
}

TEST_F(ClientSharesTest, UsageStaysTheSameOverChangeAndCrash) {
  TestWorker worker = join("w");
  finish_job(worker, create_job("shot"));  // six units of 0.5 s
  ASSERT_TRUE(set("ann", 2).ok());
  EXPECT_NEAR(coordinator->shares().list("ann").at(0).usage, 3, 1e-9);
  ASSERT_TRUE(set("ann", 100).ok());
  EXPECT_NEAR(coordinator->shares().list("ann").at(0).usage, 3, 1e-9);
  start();  // no tick has written the use
  EXPECT_NEAR(coordinator->shares().list("ann").at(0).usage, 3, 1e-9);
}

TEST_F(ClientSharesTest, NumberOfSetWeightsIsLimited) {
  Settings rows;
  for (std::size_t i = 0; i < ClientShares::kMaxSet; ++i) rows["c" + std::to_string(i)] = "2";
  ASSERT_TRUE(store.settings().save(SettingKind::share, rows).ok());
  start();
  EXPECT_TRUE(absl::IsResourceExhausted(set("ann", 3).status()));
  EXPECT_TRUE(set("c0", 3).ok());
  ASSERT_TRUE(reset("c1").ok());
  EXPECT_TRUE(set("ann", 3).ok());
}

}  // namespace
}  // namespace tessera::server
