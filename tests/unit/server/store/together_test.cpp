// Several writes as one transaction.
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/store/store.h"
#include "tests/support/disk/failing_disk.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {
namespace {

class TogetherTest : public ::testing::Test {
 protected:
  TogetherTest() { open(); }
  void open() {
    store_.reset();
    auto opened = Store::open(folder_.path() + "/store", disk_);
    ASSERT_TRUE(opened.ok()) << opened.status();
    store_ = *std::move(opened);
  }
  static JobRecord job(const std::string& id) {
    JobRecord record;
    record.id = record.name = id;
    record.request_id = "request-" + id;
    return record;
  }
  std::vector<std::string> jobs() {
    std::vector<std::string> ids;
    const auto records = store_->jobs().list();
    for (const JobRecord& record : *records) ids.push_back(record.id);
    return ids;
  }
  absl::Status commit(const std::string& job_id, std::int32_t tile) {
    Commit unit;
    unit.job_id = job_id;
    unit.record.unit = {0, tile, 0};
    unit.block = std::string(1000, 'b');
    unit.record.sha256 = contract::sha256(unit.block);
    std::vector<Commit> group = {unit};
    return store_->units().commit(group);
  }
  int unit_count(const std::string& job_id) {
    int count = 0;
    EXPECT_TRUE(store_->units().for_each(job_id, [&](const UnitRecord&) { ++count; }).ok());
    return count;
  }

  bool has_ballast() const { return std::filesystem::exists(folder_.path() + "/store/ballast"); }

  ScratchFolder folder_;
  testing::FailingDisk disk_;
  std::unique_ptr<Store> store_;
};

TEST_F(TogetherTest, FailedPartLeavesOtherParts) {
  JobRecord a = job("a"), b = job("b"), again = job("a");
  const absl::Status together = store_->write_together([&] {
    EXPECT_TRUE(store_->jobs().add(a).ok());
    EXPECT_TRUE(absl::IsAlreadyExists(store_->jobs().add(again)));
    EXPECT_TRUE(commit("a", 0).ok());
    EXPECT_TRUE(absl::IsAlreadyExists(commit("a", 0)));
    EXPECT_TRUE(absl::IsNotFound(commit("none", 0)));
    EXPECT_TRUE(store_->jobs().add(b).ok());
  });
  EXPECT_TRUE(together.ok()) << together;
  open();
  EXPECT_EQ(jobs(), (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(unit_count("a"), 1);
}

TEST_F(TogetherTest, FullDiskWritesNothing) {
  JobRecord a = job("a"), b = job("b");
  ASSERT_TRUE(store_->jobs().add(a).ok());
  ASSERT_TRUE(commit("a", 0).ok());
  const std::int64_t before = store_->used_bytes();
  disk_.fail_sqlite_writes("store.db-wal");
  const absl::Status together = store_->write_together([&] {
    store_->jobs().add(b).IgnoreError();
    commit("a", 1).IgnoreError();
  });
  EXPECT_TRUE(absl::IsResourceExhausted(together)) << together;
  disk_.recover();
  EXPECT_EQ(jobs(), std::vector<std::string>{"a"});
  EXPECT_EQ(unit_count("a"), 1);
  EXPECT_EQ(store_->used_bytes(), before);
  const absl::Status again = store_->write_together([&] {
    EXPECT_TRUE(store_->jobs().add(b).ok());
    EXPECT_TRUE(commit("a", 1).ok());
  });
  EXPECT_TRUE(again.ok()) << again;
  open();
  EXPECT_EQ(jobs(), (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(unit_count("a"), 2);
}

TEST_F(TogetherTest, FullDiskGivesUpBallastToRemoveJob) {
  JobRecord a = job("a"), b = job("b");
  ASSERT_TRUE(store_->jobs().add(a).ok());
  ASSERT_TRUE(store_->jobs().add(b).ok());
  ASSERT_TRUE(commit("a", 0).ok());
  ASSERT_TRUE(commit("a", 1).ok());
  ASSERT_TRUE(has_ballast());
  disk_.fail_sqlite_writes("store.db-wal");
  disk_.recover_when_removed("ballast");
  int calls = 0;
  const absl::Status together = store_->write_together([&] {
    ++calls;
    commit("b", 0).IgnoreError();
    store_->jobs().remove("a").IgnoreError();
  });
  ASSERT_TRUE(together.ok()) << together;
  EXPECT_EQ(calls, 2) << "all parts are written again";
  EXPECT_EQ(jobs(), std::vector<std::string>{"b"});
  EXPECT_EQ(unit_count("b"), 1);
  EXPECT_TRUE(has_ballast()) << "there is room again";
  const std::int64_t used_bytes = store_->used_bytes();
  open();
  EXPECT_EQ(store_->used_bytes(), used_bytes) << "the failed attempt does not count";
}

TEST_F(TogetherTest, FullDiskKeepsBallastIfNothingIsFreed) {
  JobRecord a = job("a"), b = job("b");
  ASSERT_TRUE(store_->jobs().add(a).ok());
  ASSERT_TRUE(store_->jobs().add(b).ok());
  ASSERT_TRUE(store_->jobs().remove("a").ok())
      << "an earlier removal has no effect on later writes";
  disk_.fail_sqlite_writes("store.db-wal");
  const absl::Status together = store_->write_together([&] { commit("b", 0).IgnoreError(); });
  EXPECT_TRUE(absl::IsResourceExhausted(together)) << together;
  EXPECT_TRUE(has_ballast());
}

TEST_F(TogetherTest, BlocksOfClosedJobLastUntilTheEnd) {
  JobRecord a = job("a");
  ASSERT_TRUE(store_->jobs().add(a).ok());
  ASSERT_TRUE(commit("a", 0).ok());
  UnitRecord unit;
  ASSERT_TRUE(store_->units().for_each("a", [&](const UnitRecord& record) { unit = record; }).ok());
  const absl::Status together = store_->write_together([&] {
    EXPECT_TRUE(store_->units().close_job("a").ok());
    EXPECT_TRUE(store_->units().read_block("a", unit).ok()) << "the transaction may still fail";
  });
  EXPECT_TRUE(together.ok()) << together;
  EXPECT_TRUE(absl::IsNotFound(store_->units().read_block("a", unit).status()));
}

}  // namespace
}  // namespace tessera::server
