#include <gtest/gtest.h>

#include "server/store/store.h"
#include "tests/unit/server/store/store_fixture.h"

namespace tessera::server {
namespace {

using StoreWorkersTest = StoreFixture;

TEST_F(StoreWorkersTest, BansPersist) {
  ASSERT_TRUE(store().workers().ban_worker("w2").ok());
  ASSERT_TRUE(store().workers().ban_worker("w1").ok());
  ASSERT_TRUE(store().workers().ban_worker("w1").ok());
  ASSERT_TRUE(store().workers().allow_worker("w2").ok());
  ASSERT_TRUE(store().workers().allow_worker("nobody").ok());
  open();
  EXPECT_EQ(*store().workers().banned_workers(), (std::vector<std::string>{"w1"}));
}

TEST_F(StoreWorkersTest, SettingsPersistByKind) {
  EXPECT_TRUE(store().settings().read(SettingKind::limit)->empty());
  ASSERT_TRUE(store().settings().save(SettingKind::limit, {{"a", "1"}, {"b", "2"}}).ok());
  ASSERT_TRUE(store().settings().save(SettingKind::pool, {{"a", "night"}}).ok());
  ASSERT_TRUE(store().settings().save(SettingKind::limit, {{"b", "3"}}).ok());
  open();
  EXPECT_EQ(*store().settings().read(SettingKind::limit), (Settings{{"b", "3"}}));
  EXPECT_EQ(*store().settings().read(SettingKind::pool), (Settings{{"a", "night"}}));
  EXPECT_TRUE(store().settings().read(SettingKind::use)->empty());
}

TEST_F(StoreWorkersTest, WorkersPersist) {
  ASSERT_TRUE(store().workers().add_worker("w2", "second").ok());
  ASSERT_TRUE(store().workers().add_worker("w1", "first").ok());
  ASSERT_TRUE(store().workers().add_worker("w1", "first again").ok());
  ASSERT_TRUE(store().workers().add_worker("w3", "third").ok());
  ASSERT_TRUE(store().workers().remove_worker("w3").ok());
  ASSERT_TRUE(store().workers().remove_worker("nobody").ok());
  open();
  EXPECT_EQ(*store().workers().roster(), (std::vector<std::string>{"w1", "w2"}));
}

TEST_F(StoreWorkersTest, TokenJoinsAreCountedPerWorker) {
  EXPECT_TRUE(store().workers().record_join({"one", "token", "rack"}, 2).ok());
  EXPECT_TRUE(store().workers().record_join({"two", "token", "rack"}, 2).ok());
  open();
  EXPECT_TRUE(
      absl::IsPermissionDenied(store().workers().record_join({"three", "token", "rack"}, 2)));
  EXPECT_TRUE(store().workers().record_join({"one", "token", "rack"}, 2).ok())
      << "it has joined already";
  EXPECT_TRUE(store().workers().record_join({"three", "other", "rack"}, 1).ok());
  EXPECT_TRUE(store().workers().record_join({"four", "token", "rack"}, 0).ok()) << "no limit";
}

TEST_F(StoreWorkersTest, WorkerIdIsBoundToCertificate) {
  EXPECT_TRUE(store().workers().record_join({"one", "token", "rack"}, 0).ok());
  open();
  EXPECT_TRUE(
      absl::IsPermissionDenied(store().workers().record_join({"one", "token", "thief"}, 0)));
  EXPECT_TRUE(
      absl::IsPermissionDenied(store().workers().record_join({"one", "other", "thief"}, 0)));
}

TEST_F(StoreWorkersTest, OldJoinsOfDeletedTokensExpire) {
  for (const char* worker : {"gone", "here", "late", "counted"}) {
    const std::string token = worker == std::string("counted") ? "valid" : "expired";
    ASSERT_TRUE(store().workers().record_join({worker, token, "rack"}, 0).ok());
  }
  ASSERT_TRUE(store().workers().add_worker("here", "here").ok());
  ASSERT_TRUE(store().workers().add_worker("late", "late").ok());
  now_us_ += 2 * kHourUs;
  ASSERT_TRUE(store().workers().remove_worker("late").ok());
  ASSERT_TRUE(store().workers().remove_stale_joins({"valid"}, now_us_ - kHourUs).ok());
  open();
  for (const char* worker : {"here", "late", "counted"}) {
    EXPECT_TRUE(absl::IsPermissionDenied(store().workers().record_join({worker, "t", "thief"}, 0)))
        << worker;
  }
  EXPECT_TRUE(store().workers().record_join({"gone", "t", "other"}, 0).ok());
}

}  // namespace
}  // namespace tessera::server
