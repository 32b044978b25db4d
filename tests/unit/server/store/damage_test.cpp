// Damaged stores and failing disks are reported, and nothing gets worse.

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "server/store/sqlite/database.h"
#include "server/store/sqlite/schema.h"
#include "server/store/store.h"
#include "tests/support/disk/failing_disk.h"
#include "tests/support/disk/older_schema.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/server/store/durability_checker.h"

namespace tessera::server {
namespace {

using testing::FailingDisk;

class DamageTest : public ::testing::Test {
 protected:
  std::string path() const { return folder_.path() + "/store"; }
  std::string segment() const { return path() + "/segments/a/0.seg"; }

  absl::StatusOr<std::unique_ptr<Store>> open(Filesystem& filesystem = real_filesystem()) {
    StoreOptions options = files_only();
    options.fatal = [this](const std::string& message) { deaths_.push_back(message); };
    options.warn = [this](const std::string& line) { warnings_.push_back(line); };
    options.checkpoint_pages = checkpoint_pages_;
    return Store::open(path(), filesystem, options);
  }

  static std::vector<Commit> some_units(int frame) {
    return {make_commit("a", {frame, 0, 0}, std::string(5000, 'x')),
            make_commit("a", {frame, 1, 0}, std::string(5000, 'y'))};
  }

  /// A store with job "a" and two units, closed.
  std::vector<Commit> make_store() {
    auto store = open();
    EXPECT_TRUE(store.ok()) << store.status();
    JobRecord job;
    job.id = "a";
    EXPECT_TRUE((*store)->jobs().add(job).ok());
    std::vector<Commit> group = some_units(0);
    EXPECT_TRUE((*store)->units().commit(group).ok());
    return group;
  }

  static void overwrite(const std::string& file, std::int64_t offset, const std::string& bytes) {
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    ASSERT_TRUE(stream.is_open()) << file;
    stream.seekp(offset);
    stream << bytes;
  }

  void change_rows(const std::string& sql) const {
    const auto rows = Database::open(path() + "/store.db", "", Database::Mode::writer);
    ASSERT_TRUE(rows.ok()) << rows.status();
    const absl::Status changed = (*rows)->script(sql.c_str());
    ASSERT_TRUE(changed.ok()) << changed;
  }
  std::int64_t stored_schema() const {
    std::int64_t version = -1;
    const auto rows = Database::open(path() + "/store.db", "", Database::Mode::reader);
    EXPECT_TRUE(rows.ok()) << rows.status();
    EXPECT_TRUE(
        (*rows)
            ->each("PRAGMA user_version", {}, [&](const SqlRow& row) { version = row.integer(0); })
            .ok());
    return version;
  }

  ScratchFolder folder_;
  std::vector<std::string> deaths_, warnings_;
  int checkpoint_pages_ = 2000;
};

TEST_F(DamageTest, FlippedByteInBlockIsDataLoss) {
  const std::vector<Commit> group = make_store();
  overwrite(segment(), group[1].record.offset + 77, "z");
  const auto store = open();
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_TRUE((*store)->units().read_block("a", group[0].record).ok());
  const auto block = (*store)->units().read_block("a", group[1].record);
  EXPECT_TRUE(absl::IsDataLoss(block.status())) << block.status();
}

TEST_F(DamageTest, TruncatedSegmentLosesOnlyItsUnits) {
  const std::vector<Commit> group = make_store();
  std::filesystem::resize_file(segment(), 7000);
  const auto store = open();
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_TRUE((*store)->units().read_block("a", group[0].record).ok());
  EXPECT_TRUE(absl::IsDataLoss((*store)->units().read_block("a", group[1].record).status()));
  ASSERT_TRUE((*store)->units().drop("a", {group[1].record.unit}).ok());
  std::vector<Commit> again = {group[1]};
  ASSERT_TRUE((*store)->units().commit(again).ok());
  EXPECT_EQ(*(*store)->units().read_block("a", again[0].record), group[1].block);
}

TEST_F(DamageTest, MissingSegmentIsDataLoss) {
  const std::vector<Commit> group = make_store();
  std::filesystem::remove(segment());
  const auto store = open();
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_TRUE(absl::IsDataLoss((*store)->units().read_block("a", group[0].record).status()));
}

TEST_F(DamageTest, HugeRecordSizeDoesNotAllocate) {
  const std::vector<Commit> group = make_store();
  const auto store = open();
  ASSERT_TRUE(store.ok());
  UnitRecord record = group[0].record;
  record.stored_bytes = std::int64_t{1} << 60;
  EXPECT_TRUE(absl::IsDataLoss((*store)->units().read_block("a", record).status()));
  record.stored_bytes = -1;
  EXPECT_TRUE(absl::IsDataLoss((*store)->units().read_block("a", record).status()));
}

TEST_F(DamageTest, NonDatabaseFileIsRefused) {
  make_store();
  overwrite(path() + "/store.db", 0, std::string(100, '#'));
  const auto store = open();
  EXPECT_TRUE(absl::IsDataLoss(store.status())) << store.status();
  EXPECT_TRUE(absl::StrContains(store.status().message(), "store.db")) << store.status();
}

TEST_F(DamageTest, UnreadableRowsAreReported) {
  make_store();
  const auto size = std::filesystem::file_size(path() + "/store.db");
  for (std::uintmax_t page = 1; page * 4096 < size; ++page) {
    overwrite(path() + "/store.db", static_cast<std::int64_t>(page * 4096),
              std::string(64, '\xee'));
  }
  const auto store = open();
  EXPECT_TRUE(absl::IsDataLoss(store.status())) << store.status();
  EXPECT_TRUE(std::filesystem::exists(segment())) << "a damaged table must not look like orphans";
}

TEST_F(DamageTest, NextSchemaIsRefusedAndStoreIsUnchanged) {
  make_store();
  const std::int64_t next = schema_version() + 1;
  change_rows(absl::StrCat("PRAGMA user_version=", next));
  const auto store = open();
  EXPECT_TRUE(absl::IsFailedPrecondition(store.status())) << store.status();
  EXPECT_EQ(store.status().message(),
            absl::StrCat("store ", path(), ": the store has schema ", next,
                         ", written by a newer version; this version reads schema ", next - 1,
                         " and older: upgrade this program"));
  EXPECT_EQ(stored_schema(), next);
  EXPECT_TRUE(std::filesystem::exists(segment()));
}

TEST_F(DamageTest, EveryOlderSchemaIsMigrated) {
  const std::vector<Commit> group = make_store();
  for (std::int64_t version = schema_version() - 1; version >= 1; --version) {
    change_rows(sql_to_older_schema(version));
    ASSERT_EQ(stored_schema(), version);
    const auto store = open();
    ASSERT_TRUE(store.ok()) << "schema " << version << ": " << store.status();
    EXPECT_EQ(stored_schema(), schema_version()) << "from schema " << version;
    std::size_t units = 0;
    EXPECT_TRUE((*store)->units().for_each("a", [&](const UnitRecord&) { ++units; }).ok());
    EXPECT_EQ(units, group.size()) << "from schema " << version;
    EXPECT_EQ(*(*store)->units().read_block("a", group[0].record), group[0].block);
  }
}

TEST_F(DamageTest, StoreOfFirstSchemaIsWritable) {
  make_store();
  change_rows(sql_to_older_schema(1));
  const auto store = open();
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_TRUE((*store)->workers().record_join({"worker", "token", "certificate"}, 1).ok());
  EXPECT_TRUE((*store)->workers().ban_worker("worker").ok());
  EXPECT_EQ((*store)->jobs().list()->front().render_contract, 10) << "the last unrecorded one";
}

TEST_F(DamageTest, MigrationAddsTotalsOfDoneJobs) {
  make_store();
  change_rows(absl::StrCat("UPDATE jobs SET state=4; ", sql_to_older_schema(4)));
  const auto store = open();
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_TRUE((*store)->units().for_each("a", [](const UnitRecord&) { FAIL(); }).ok());
  const auto totals = (*store)->units().totals("a");
  ASSERT_TRUE(totals.ok()) << totals.status();
  ASSERT_EQ(totals->size(), 1U);
  EXPECT_EQ((*totals)[0].units, 2);
  EXPECT_EQ((*totals)[0].cpu_seconds, 0.5);
}

/// The rows are durable; reported as a failure, their units could never be committed again.
TEST_F(DamageTest, FullDiskAtCheckpointFailsNothing) {
  checkpoint_pages_ = 1;
  make_store();
  FailingDisk disk;
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  disk.fail_sqlite_writes("store.db");
  std::vector<Commit> group = some_units(1);
  EXPECT_TRUE((*store)->units().commit(group).ok());
  EXPECT_EQ(*(*store)->units().read_block("a", group[0].record), group[0].block);
  disk.recover();
  std::vector<Commit> next = some_units(2);
  EXPECT_TRUE((*store)->units().commit(next).ok());
  EXPECT_TRUE(deaths_.empty());
}

TEST_F(DamageTest, ForeignDatabaseIsRefused) {
  std::filesystem::create_directory(path());
  change_rows("CREATE TABLE theirs(x); PRAGMA user_version=1");
  const auto store = open();
  EXPECT_TRUE(absl::IsDataLoss(store.status())) << store.status();
}

TEST_F(DamageTest, FullDiskFailsOnlyItsGroup) {
  const std::vector<Commit> before = make_store();
  FailingDisk disk;
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  disk.fail_write_after(7000);  // in the middle of the second block
  std::vector<Commit> group = some_units(1);
  const absl::Status full = (*store)->units().commit(group);
  EXPECT_TRUE(absl::IsResourceExhausted(full)) << full;
  disk.recover();
  ASSERT_TRUE((*store)->units().commit(group).ok());
  for (const Commit& commit : group) {
    EXPECT_EQ(*(*store)->units().read_block("a", commit.record), commit.block);
  }
  EXPECT_TRUE((*store)->units().read_block("a", before[0].record).ok());
  EXPECT_TRUE(deaths_.empty());
}

TEST_F(DamageTest, FailedSegmentSyncEndsProcess) {
  make_store();
  FailingDisk disk;
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  disk.fail_syncs();
  std::vector<Commit> group = some_units(1);
  EXPECT_TRUE(absl::IsDataLoss((*store)->units().commit(group)));
  ASSERT_EQ(deaths_.size(), 1U);
  disk.recover();
  EXPECT_TRUE(absl::IsDataLoss((*store)->units().commit(group))) << "it is not posted again";
  EXPECT_EQ(disk.syncs_after_failure(), 0);
  int count = 0;
  EXPECT_TRUE((*store)->units().for_each("a", [&](const UnitRecord&) { ++count; }).ok());
  EXPECT_EQ(count, 2);
}

TEST_F(DamageTest, FailedAssetOrImageSyncEndsProcess) {
  make_store();
  FailingDisk disk;
  {
    const auto store = open(disk);
    ASSERT_TRUE(store.ok()) << store.status();
    const std::string upload = *(*store)->assets().new_upload_path();
    std::ofstream(upload) << "texture";
    disk.fail_syncs();
    EXPECT_TRUE(absl::IsDataLoss((*store)->assets().publish(upload, contract::sha256("texture"))));
    EXPECT_FALSE((*store)->assets().has(contract::sha256("texture")));
    EXPECT_EQ(deaths_.size(), 1U);
  }
  disk.recover();
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  FrameRecord frame;
  frame.file = "image.exr";
  std::ofstream(*(*store)->frames().output_folder("a") + "/image.exr") << "image";
  disk.fail_syncs();
  EXPECT_TRUE(absl::IsDataLoss((*store)->frames().finish("a", frame)));
  EXPECT_EQ(deaths_.size(), 2U);
  EXPECT_TRUE((*store)->frames().list("a")->empty());
}

TEST_F(DamageTest, FolderThatCannotBeOpenedIsNoFailedSync) {
  make_store();
  FailingDisk disk;
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  disk.fail_opening_folders();
  std::vector<Commit> group = some_units(1);
  EXPECT_TRUE(absl::IsUnavailable((*store)->units().commit(group)));
  EXPECT_TRUE(deaths_.empty());
  disk.recover();
  EXPECT_TRUE((*store)->units().commit(group).ok());
}

TEST_F(DamageTest, FullDiskGivesUpBallastToRemoveJob) {
  make_store();
  FailingDisk disk;
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  ASSERT_GT(std::filesystem::file_size(path() + "/ballast"), 1U << 20);
  disk.fail_sqlite_writes("store.db-wal");
  JobRecord job;
  job.id = "a";
  job.reason = "changed";
  EXPECT_FALSE((*store)->jobs().update(job).ok()) << "only what frees space may use the ballast";
  disk.recover_when_removed("ballast");
  job.end_time_us = 1;
  EXPECT_TRUE((*store)->jobs().update(job).ok());
  EXPECT_FALSE(std::filesystem::exists(path() + "/ballast"));
  EXPECT_TRUE((*store)->jobs().remove("a").ok());
  EXPECT_FALSE(std::filesystem::exists(segment()));
  EXPECT_TRUE(std::filesystem::exists(path() + "/ballast")) << "there is room again";
}

TEST_F(DamageTest, StoreOnFullDiskStartsWithoutBallast) {
  make_store();
  FailingDisk disk;
  disk.fail_sqlite_writes("store.db-wal");
  disk.recover_when_removed("ballast.start");
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  ASSERT_EQ(warnings_.size(), 1U);
  EXPECT_NE(warnings_[0].find("is full"), std::string::npos) << warnings_[0];
  EXPECT_TRUE(std::filesystem::exists(path() + "/ballast")) << "to remove jobs";
}

TEST_F(DamageTest, StrayFilesAreSkippedWithWarning) {
  make_store();
  const std::vector<std::string> strays = {path() + "/assets/README", path() + "/segments/notes",
                                           path() + "/outputs/lost+found",
                                           path() + "/segments/a/folder/file"};
  std::filesystem::create_directory(path() + "/segments/a/folder");
  for (const std::string& stray : strays) std::ofstream(stray) << "x";
  const auto store = open();
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_EQ(warnings_.size(), strays.size());
  for (const std::string& stray : strays) EXPECT_TRUE(std::filesystem::exists(stray)) << stray;
  std::vector<Commit> group = some_units(0);
  EXPECT_TRUE(absl::IsAlreadyExists((*store)->units().commit(group)))
      << "its units are still there";
}

TEST_F(DamageTest, LostOrTruncatedAssetIsUploadedAgain) {
  const auto store = open();
  ASSERT_TRUE(store.ok()) << store.status();
  const contract::Digest digest = contract::sha256("texture");
  const auto publish = [&] {
    const std::string upload = *(*store)->assets().new_upload_path();
    std::ofstream(upload) << "texture";
    return (*store)->assets().publish(upload, digest);
  };
  ASSERT_TRUE(publish().ok());
  const std::int64_t used = (*store)->used_bytes();
  std::filesystem::remove(asset_file(path(), digest));
  EXPECT_FALSE((*store)->assets().has(digest));
  ASSERT_TRUE(publish().ok());
  EXPECT_TRUE((*store)->assets().has(digest));
  std::filesystem::resize_file(asset_file(path(), digest), 3);
  EXPECT_FALSE((*store)->assets().has(digest));
  ASSERT_TRUE(publish().ok());
  EXPECT_TRUE((*store)->assets().has(digest));
  EXPECT_EQ((*store)->used_bytes(), used);
}

TEST_F(DamageTest, LackOfDescriptorsIsNoFullDisk) {
  const ScratchFolder folder;
  Filesystem& disk = real_filesystem();
  // UndefinedBehaviorSanitizer takes descriptors for its first look at a type.
  ASSERT_TRUE(disk.list(folder.path()).ok());
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none{0, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &none), 0);
  const absl::Status opened = disk.open(folder.path() + "/file").status();
  const absl::Status listed = disk.list(folder.path()).status();
  const absl::Status synced = disk.sync_folder(folder.path());
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &before), 0);
  for (const absl::Status& status : {opened, listed, synced}) {
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  }
}

TEST_F(DamageTest, FailedSqliteSyncEndsProcess) {
  make_store();
  FailingDisk disk;
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  disk.fail_sqlite_syncs("store.db-wal");
  EXPECT_TRUE(absl::IsDataLoss((*store)->workers().add_worker("w", "w")));
  EXPECT_EQ(deaths_.size(), 1U);
}

TEST_F(DamageTest, FailedCheckpointSyncEndsProcess) {
  checkpoint_pages_ = 1;
  make_store();
  FailingDisk disk;
  const auto store = open(disk);
  ASSERT_TRUE(store.ok()) << store.status();
  disk.fail_sqlite_syncs("store.db");
  EXPECT_TRUE(absl::IsDataLoss((*store)->workers().add_worker("w", "w")));
  EXPECT_EQ(deaths_.size(), 1U);
}

TEST(DamageDeathTest, FailedSyncExitsWithMessage) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  const ScratchFolder folder;
  const auto die = [&] {
    FailingDisk disk;
    auto store = Store::open(folder.path() + "/store", disk);
    disk.fail_sqlite_syncs("store.db-wal");
    if (store.ok()) (*store)->workers().add_worker("w", "w").IgnoreError();
    std::exit(0);
  };
  EXPECT_EXIT(die(), ::testing::ExitedWithCode(1), "fsync failed; exiting");
}

}  // namespace
}  // namespace tessera::server
