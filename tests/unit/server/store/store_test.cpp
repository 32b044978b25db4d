#include "server/store/store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <limits>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/unit/server/store/store_fixture.h"

namespace tessera::server {
namespace {

using StoreTest = StoreFixture;

TEST_F(StoreTest, KeepsIdAndKeyAndCountsBoots) {
  const std::string id = store().id();
  const std::string key = store().key();
  EXPECT_EQ(id.size(), 32U);
  EXPECT_EQ(key.size(), 32U);
  EXPECT_EQ(store().boot_count(), 1);
  open();
  EXPECT_EQ(store().id(), id);
  EXPECT_EQ(store().key(), key);
  EXPECT_EQ(store().boot_count(), 2);
  const ScratchFolder other_folder;
  const auto other = Store::open(other_folder.path() + "/store", real_filesystem());
  ASSERT_TRUE(other.ok());
  EXPECT_NE((*other)->id(), id);
  EXPECT_NE((*other)->key(), key);
}

TEST_F(StoreTest, FilesArePrivate) {
  for (const char* name : {"", "/store.db", "/store.db-wal"}) {
    struct stat info {};
    ASSERT_EQ(::stat((path() + name).c_str(), &info), 0) << name;
    EXPECT_EQ(info.st_mode & 077, 0U) << name;
  }
}

TEST_F(StoreTest, RefusesSecondOpen) {
  const auto second = Store::open(path(), real_filesystem());
  EXPECT_TRUE(absl::IsFailedPrecondition(second.status())) << second.status();
  EXPECT_EQ(store().boot_count(), 1);
}

TEST_F(StoreTest, RefusesFolderWithMissingParent) {
  const auto store = Store::open(folder_.path() + "/no/store", real_filesystem());
  EXPECT_TRUE(absl::IsNotFound(store.status())) << store.status();
}

TEST_F(StoreTest, JobsRoundTripInSubmissionOrder) {
  JobRecord second = add_job("z");
  const JobRecord first = add_job("a");
  EXPECT_LT(second.sequence, first.sequence);
  second.state = 3;
  second.reason = "because";
  second.end_time_us = std::numeric_limits<std::int64_t>::max();
  second.wall_seconds = 0.1;
  second.render_contract = 4;
  second.failure_code = 5;
  ASSERT_TRUE(store().jobs().update(second).ok());
  open();
  const auto jobs = store().jobs().list();
  ASSERT_TRUE(jobs.ok());
  ASSERT_EQ(jobs->size(), 2U);
  const JobRecord& found = jobs->front();
  EXPECT_EQ(found.id, "z");
  EXPECT_EQ(found.sequence, second.sequence);
  EXPECT_EQ(found.request_id, "request-z");
  EXPECT_EQ(found.name, second.name);
  EXPECT_EQ(found.owner, "owner");
  EXPECT_EQ(found.request, second.request);
  EXPECT_EQ(found.state, 3);
  EXPECT_EQ(found.reason, "because");
  EXPECT_EQ(found.create_time_us, 1234567);
  EXPECT_EQ(found.end_time_us, second.end_time_us);
  EXPECT_EQ(found.wall_seconds, 0.1);
  EXPECT_EQ(found.render_contract, 4);
  EXPECT_EQ(found.failure_code, 5);
  EXPECT_EQ(jobs->back().id, "a");
  EXPECT_EQ(jobs->back().render_contract, 3);
}

TEST_F(StoreTest, RefusesRepeatedJob) {
  add_job("a");
  JobRecord same_id;
  same_id.id = "a";
  EXPECT_TRUE(absl::IsAlreadyExists(store().jobs().add(same_id)));
  JobRecord same_request;
  same_request.id = "b";
  same_request.request_id = "request-a";
  EXPECT_TRUE(absl::IsAlreadyExists(store().jobs().add(same_request)));
  EXPECT_EQ(store().jobs().list()->size(), 1U);
}

TEST_F(StoreTest, AcceptsJobsWithoutRequestId) {
  for (const char* id : {"a", "b"}) {
    JobRecord job;
    job.id = id;
    EXPECT_TRUE(store().jobs().add(job).ok());
  }
}

TEST_F(StoreTest, RefusesIdThatIsNoFileName) {
  for (const std::string id : {"", ".", "..", "../a", "a/b", ".hidden", "a b", "ä"}) {
    JobRecord job;
    job.id = id;
    EXPECT_TRUE(absl::IsInvalidArgument(store().jobs().add(job))) << id;
    EXPECT_TRUE(absl::IsInvalidArgument(store().frames().output_folder(id).status())) << id;
  }
}

TEST_F(StoreTest, NeverReusesIdOfRemovedJob) {
  const JobRecord job = add_job("a");
  ASSERT_TRUE(store().jobs().remove("a").ok());
  open();
  EXPECT_TRUE(store().jobs().list()->empty());
  JobRecord again = job;
  EXPECT_TRUE(absl::IsAlreadyExists(store().jobs().add(again)));
  JobRecord retried = job;
  retried.id = "b";
  EXPECT_TRUE(absl::IsAlreadyExists(store().jobs().add(retried)));
  EXPECT_GT(add_job("c").sequence, job.sequence);
}

TEST_F(StoreTest, StateOfRemovedJobIsKept) {
  JobRecord job = add_job("a");
  EXPECT_EQ(*store().jobs().removed_state("a"), std::nullopt) << "it is not removed";
  job.state = 6;
  ASSERT_TRUE(store().jobs().update(job).ok());
  ASSERT_TRUE(store().jobs().remove("a").ok());
  open();
  EXPECT_EQ(*store().jobs().removed_state("a"), 6);
  EXPECT_EQ(*store().jobs().removed_state("nobody"), 0);
}

TEST_F(StoreTest, UnknownJobIsNotFound) {
  JobRecord job;
  job.id = "nobody";
  std::vector<Commit> group = {make_commit("nobody", {0, 0, 0}, "block")};
  EXPECT_TRUE(absl::IsNotFound(store().jobs().update(job)));
  EXPECT_TRUE(absl::IsNotFound(store().jobs().remove("nobody")));
  EXPECT_TRUE(absl::IsNotFound(store().units().commit(group)));
  EXPECT_TRUE(absl::IsNotFound(store().units().drop("nobody", {})));
  EXPECT_TRUE(absl::IsNotFound(store().frames().finish("nobody", {})));
  EXPECT_TRUE(absl::IsNotFound(store().units().close_job("nobody")));
  EXPECT_TRUE(units("nobody").empty());
  EXPECT_TRUE(store().units().totals("nobody")->empty());
  EXPECT_TRUE(store().frames().list("nobody")->empty());
}

TEST_F(StoreTest, BlocksRoundTripInUnitOrder) {
  add_job("a");
  add_job("b");
  std::vector<Commit> group;
  for (const contract::Unit unit : {contract::Unit{1, 0, 0}, {0, 2, 1}, {0, 2, 0}, {0, 1, 0}}) {
    const std::string bytes = std::to_string(unit.frame) + std::to_string(unit.tile) +
                              std::to_string(unit.pass) + std::string(500'000, 'x');
    group.push_back(make_commit("a", unit, bytes));
    group.push_back(make_commit("b", unit, "b" + bytes));
  }
  ASSERT_TRUE(store().units().commit(group).ok());
  open();
  const std::vector<UnitRecord> found = units("a");
  ASSERT_EQ(found.size(), 4U);
  EXPECT_EQ(found[0].unit, (contract::Unit{0, 1, 0}));
  EXPECT_EQ(found[1].unit, (contract::Unit{0, 2, 0}));
  EXPECT_EQ(found[2].unit, (contract::Unit{0, 2, 1}));
  EXPECT_EQ(found[3].unit, (contract::Unit{1, 0, 0}));
  for (const Commit& commit : group) {
    const auto block = store().units().read_block(commit.job_id, commit.record);
    ASSERT_TRUE(block.ok()) << block.status();
    EXPECT_EQ(*block, commit.block);
    EXPECT_EQ(commit.record.size_bytes, static_cast<std::int64_t>(commit.block.size()));
  }
  EXPECT_EQ(found[0].worker_id, "worker");
  EXPECT_EQ(found[0].cpu_seconds, 0.25);
}

TEST_F(StoreTest, GroupCommitIsAtomic) {
  add_job("a");
  commit("a", 0, 1);
  std::vector<Commit> group = {make_commit("a", {0, 7, 0}, "new"),
                               make_commit("a", {0, 0, 0}, "a second result")};
  EXPECT_TRUE(absl::IsAlreadyExists(store().units().commit(group)));
  ASSERT_EQ(units("a").size(), 1U);
  EXPECT_EQ(*store().units().read_block("a", units("a")[0]), std::string(100, 'a'));
  group.pop_back();
  EXPECT_TRUE(store().units().commit(group).ok());
  EXPECT_EQ(*store().units().read_block("a", group[0].record), "new");
}

TEST_F(StoreTest, StartsNewSegmentWhenFullOrRestarted) {
  segment_bytes_ = 1000;
  open();
  add_job("a");
  commit("a", 0, 5, 300);  // a group stays together
  commit("a", 1, 1, 300);
  open();
  commit("a", 2, 1, 300);
  const std::vector<UnitRecord> found = units("a");
  ASSERT_EQ(found.size(), 7U);
  EXPECT_EQ(found[4].segment, 0);
  EXPECT_EQ(found[4].offset, 1200);
  EXPECT_EQ(found[5].segment, 1);
  EXPECT_EQ(found[6].segment, 2);
  for (const UnitRecord& unit : found) EXPECT_TRUE(store().units().read_block("a", unit).ok());
}

TEST_F(StoreTest, WritesMoreJobsThanOpenFiles) {
  std::vector<Commit> last;
  for (int round = 0; round < 2; ++round) {
    for (int job = 0; job < 80; ++job) {
      const std::string id = "job" + std::to_string(job);
      if (round == 0) add_job(id);
      last = commit(id, round, 1);
    }
  }
  for (int job = 0; job < 80; ++job) {
    for (const UnitRecord& unit : units("job" + std::to_string(job))) {
      EXPECT_EQ(unit.segment, 0);
      EXPECT_TRUE(store().units().read_block("job" + std::to_string(job), unit).ok());
    }
  }
}

TEST_F(StoreTest, DroppedUnitsCanBeCommittedAgain) {
  add_job("a");
  commit("a", 0, 3);
  ASSERT_TRUE(store().units().drop("a", {{0, 0, 0}, {0, 2, 0}, {9, 9, 9}}).ok());
  open();
  ASSERT_EQ(units("a").size(), 1U);
  std::vector<Commit> again = {make_commit("a", {0, 2, 0}, "better")};
  ASSERT_TRUE(store().units().commit(again).ok());
  EXPECT_EQ(*store().units().read_block("a", again[0].record), "better");
}

TEST_F(StoreTest, RecordsFinishedFrames) {
  add_job("a");
  const FrameRecord second = finish_frame("a", 2, "second");
  const FrameRecord first = finish_frame("a", 1, "first");
  open();
  const auto frames = store().frames().list("a");
  ASSERT_TRUE(frames.ok());
  ASSERT_EQ(frames->size(), 2U);
  EXPECT_EQ(frames->front().frame, 1);
  EXPECT_EQ(frames->front().file, first.file);
  EXPECT_EQ(frames->back().file_sha256, second.file_sha256);
  EXPECT_EQ(frames->back().pixels_sha256, second.pixels_sha256);
  EXPECT_EQ(frames->back().statistics_json, second.statistics_json);
}

TEST_F(StoreTest, RefusesFrameWithoutFile) {
  add_job("a");
  FrameRecord frame;
  frame.file = "missing.exr";
  EXPECT_TRUE(absl::IsNotFound(store().frames().finish("a", frame)));
  frame.file = "../store.db";
  EXPECT_TRUE(absl::IsInvalidArgument(store().frames().finish("a", frame)));
  EXPECT_TRUE(store().frames().list("a")->empty());
}

TEST_F(StoreTest, ClosingJobTotalsUnitsByWorker) {
  add_job("a");
  add_job("b");
  commit("b", 0, 2);
  std::vector<Commit> group;
  for (int tile = 0; tile < 5; ++tile) {
    group.push_back(make_commit("a", {0, tile, 0}, "block"));
    group.back().record.worker_id = tile < 3 ? "one" : "two";
    group.back().record.cpu_seconds = 1 << tile;
    group.back().record.audit = AuditState::open;
  }
  ASSERT_TRUE(store().units().commit(group).ok());
  ASSERT_TRUE(
      store().units().set_audits("a", {{0, 0, 0}, {0, 2, 0}, {0, 4, 0}}, AuditState::ended).ok());
  for (int times = 0; times < 2; ++times) {
    ASSERT_TRUE(store().units().close_job("a").ok());
    if (times == 1) open();
    const auto totals = store().units().totals("a");
    ASSERT_TRUE(totals.ok()) << totals.status();
    ASSERT_EQ(totals->size(), 2U);
    EXPECT_EQ((*totals)[0].worker_id, "one");
    EXPECT_EQ((*totals)[0].units, 3);
    EXPECT_EQ((*totals)[0].audited, 2);
    EXPECT_EQ((*totals)[0].cpu_seconds, 1 + 2 + 4);
    EXPECT_EQ((*totals)[1].units, 2);
    EXPECT_EQ((*totals)[1].audited, 1);
    EXPECT_EQ((*totals)[1].cpu_seconds, 8 + 16);
    EXPECT_TRUE(units("a").empty());
  }
  EXPECT_EQ(units("b").size(), 2U);
  EXPECT_TRUE(store().units().totals("b")->empty());
}

TEST_F(StoreTest, ClosingJobReleasesItsBlocks) {
  add_job("a");
  const std::vector<Commit> before = commit("a", 0, 3);
  ASSERT_TRUE(store().units().close_job("a").ok());
  EXPECT_TRUE(std::filesystem::is_empty(path() + "/segments/a"));
  EXPECT_TRUE(absl::IsNotFound(store().units().read_block("a", before[0].record).status()));
  const std::vector<Commit> later = commit("a", 1, 1);
  EXPECT_EQ(*store().units().read_block("a", later[0].record), later[0].block);
  open();
  EXPECT_TRUE(absl::IsNotFound(store().units().read_block("a", before[0].record).status()));
  EXPECT_EQ(*store().units().read_block("a", later[0].record), later[0].block);
  ASSERT_TRUE(store().units().close_job("a").ok());
  EXPECT_EQ(store().units().totals("a")->at(0).units, 4);
}

TEST_F(StoreTest, ClosingJobsShrinksJournal) {
  slack_pages_ = 8;
  checkpoint_pages_ = 1;
  open();
  const std::int64_t empty = store().used_bytes();
  add_job("a");
  commit("a", 0, 4000, 1);
  const std::int64_t full = store().used_bytes();
  EXPECT_GT(full, empty + 200'000);
  EXPECT_GT(std::filesystem::file_size(path() + "/store.db"), 200'000U)
      << "the write-ahead log is checkpointed";
  ASSERT_TRUE(store().units().close_job("a").ok());
  add_job("b");  // another write, after which the rest is released
  EXPECT_LT(store().used_bytes(), empty + 100'000);
  add_job("c");  // the next write copies the log into the file
  EXPECT_LT(std::filesystem::file_size(path() + "/store.db"),
            static_cast<std::uintmax_t>(empty) + 100'000);
}

TEST_F(StoreTest, RemovingJobDeletesAllItsData) {
  add_job("a");
  const std::vector<Commit> group = commit("a", 0, 3);
  finish_frame("a", 0, "image");
  ASSERT_TRUE(store().units().close_job("a").ok());
  ASSERT_TRUE(store().jobs().remove("a").ok());
  EXPECT_TRUE(store().units().totals("a")->empty());
  EXPECT_FALSE(std::filesystem::exists(path() + "/segments/a"));
  EXPECT_FALSE(std::filesystem::exists(path() + "/outputs/a"));
  EXPECT_TRUE(units("a").empty());
  EXPECT_TRUE(absl::IsNotFound(store().units().read_block("a", group[0].record).status()));
}

TEST_F(StoreTest, OpenDeletesFilesWithoutRow) {
  add_job("a");
  commit("a", 0, 1);
  const contract::Digest kept = upload("kept");
  write_file(path() + "/segments/a/7.seg", "written, never committed");
  std::filesystem::create_directory(path() + "/segments/gone");
  write_file(path() + "/segments/gone/0.seg", "of a removed job");
  std::filesystem::create_directory(path() + "/outputs/gone");
  write_file(path() + "/outputs/gone/image.exr", "of a removed job");
  const std::string stray = asset_file(path(), contract::sha256("stray"));
  std::filesystem::create_directories(std::filesystem::path(stray).parent_path());
  write_file(stray, "stray");
  const std::string upload = *store().assets().new_upload_path();
  write_file(upload, "half an upl");
  open();
  EXPECT_FALSE(std::filesystem::exists(path() + "/segments/a/7.seg"));
  EXPECT_FALSE(std::filesystem::exists(path() + "/segments/gone"));
  EXPECT_FALSE(std::filesystem::exists(path() + "/outputs/gone"));
  EXPECT_FALSE(std::filesystem::exists(stray));
  EXPECT_FALSE(std::filesystem::exists(upload));
  EXPECT_TRUE(store().assets().has(kept));
  EXPECT_TRUE(store().units().read_block("a", units("a")[0]).ok());
}

TEST_F(StoreTest, CountsUsedBytes) {
  const auto count_files = [&] {
    std::int64_t bytes = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(path())) {
      const std::string name = entry.path().filename().string();
      const bool is_log = name == "store.db-wal" || name == "store.db-shm" || name == "store.db";
      const bool is_content = !is_log && name.rfind("ballast", 0) != 0;
      if (entry.is_regular_file() && is_content)
        bytes += static_cast<std::int64_t>(entry.file_size());
    }
    return bytes;
  };
  const std::int64_t empty = store().used_bytes();
  EXPECT_GT(empty, 0);
  add_job("a");
  add_job("b");
  commit("a", 0, 4, 100'000);
  commit("b", 0, 2, 50'000);
  upload(std::string(70'000, 'u'));
  upload(std::string(70'000, 'u'));
  finish_frame("a", 0, std::string(30'000, 'f'));
  finish_frame("a", 0, std::string(20'000, 'g'));
  EXPECT_EQ(count_files(), 400'000 + 100'000 + 70'000 + 20'000);
  EXPECT_EQ(store().used_bytes(), empty + count_files());
  open();
  EXPECT_EQ(store().used_bytes(), empty + count_files());
  ASSERT_TRUE(store().units().close_job("b").ok());
  EXPECT_EQ(store().used_bytes(), empty + count_files());
  ASSERT_TRUE(store().jobs().remove("a").ok());
  now_us_ += 2 * kHourUs;
  ASSERT_TRUE(store().assets().collect(now_us_, 0, {}).ok());
  EXPECT_EQ(count_files(), 0);
  EXPECT_EQ(store().used_bytes(), empty);
}

TEST_F(StoreTest, ReadsDuringWrites) {
  add_job("a");
  std::thread reader([&] {
    for (int i = 0; i < 50; ++i) {
      for (const UnitRecord& unit : units("a")) {
        EXPECT_TRUE(store().units().read_block("a", unit).ok());
      }
      EXPECT_FALSE(store().assets().has(contract::sha256("x")));
      EXPECT_GT(store().used_bytes(), 0);
    }
  });
  for (int frame = 0; frame < 50; ++frame) commit("a", frame, 3);
  reader.join();
  EXPECT_EQ(units("a").size(), 150U);
}

}  // namespace
}  // namespace tessera::server
