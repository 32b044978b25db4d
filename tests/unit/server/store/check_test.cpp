// check_store() finds each kind of damage, and no false ones.
#include "server/store/maintenance/check.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "server/store/sqlite/database.h"
#include "server/store/sqlite/schema.h"
#include "server/store/store.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/server/store/durability_checker.h"

namespace tessera::server {
namespace {

class StoreCheckTest : public ::testing::Test {
 protected:
  /// A store with an asset, a job with two blocks, and a done and released job.
  StoreCheckTest() {
    auto store = Store::open(path(), real_filesystem(), files_only());
    EXPECT_TRUE(store.ok()) << store.status();
    for (const char* id : {"open", "done"}) {
      JobRecord job;
      job.id = id;
      EXPECT_TRUE((*store)->jobs().add(job).ok());
      std::vector<Commit> group = {make_commit(id, {0, 0, 0}, std::string(5000, 'x')),
                                   make_commit(id, {0, 1, 0}, std::string(5000, 'y'))};
      EXPECT_TRUE((*store)->units().commit(group).ok());
    }
    write((*store)->frames().output_folder("done").value() + "/frame.exr", "an image");
    FrameRecord frame;
    frame.file = "frame.exr";
    frame.file_sha256 = contract::sha256("an image");
    EXPECT_TRUE((*store)->frames().finish("done", frame).ok());
    EXPECT_TRUE((*store)->units().close_job("done").ok());
    const std::string upload = (*store)->assets().new_upload_path().value();
    write(upload, "an asset");
    EXPECT_TRUE((*store)->assets().publish(upload, contract::sha256("an asset")).ok());
    asset_ = asset_file(path(), contract::sha256("an asset"));
  }

  std::string path() const { return folder_.path() + "/store"; }

  static void write(const std::string& file, const std::string& bytes) {
    std::ofstream(file, std::ios::binary) << bytes;
  }

  void change_rows(const char* sql) {
    const auto rows = Database::open(path() + "/store.db", "", Database::Mode::writer);
    ASSERT_TRUE(rows.ok()) << rows.status();
    const absl::Status changed = (*rows)->script(sql);
    ASSERT_TRUE(changed.ok()) << changed;
  }

  StoreFindings check() const {
    auto findings = check_store(path(), real_filesystem());
    EXPECT_TRUE(findings.ok()) << findings.status();
    return findings.ok() ? *std::move(findings) : StoreFindings();
  }

  /// Expects exactly one fault, containing `text`.
  void expect_fault(const std::string& text) const {
    const StoreFindings found = check();
    ASSERT_EQ(found.faults.size(), 1u) << ::testing::PrintToString(found.faults);
    EXPECT_TRUE(absl::StrContains(found.faults[0], text)) << found.faults[0];
  }

  ScratchFolder folder_;
  std::string asset_;
};

TEST_F(StoreCheckTest, SoundStoreHasNoFaults) {
  const StoreFindings found = check();
  EXPECT_TRUE(found.faults.empty()) << ::testing::PrintToString(found.faults);
  EXPECT_TRUE(found.orphans.empty()) << ::testing::PrintToString(found.orphans);
  EXPECT_EQ(found.jobs, 2);
  EXPECT_EQ(found.units, 4) << "two of them in totals";
  EXPECT_EQ(found.blocks, 2) << "released blocks are not checked";
  EXPECT_EQ(found.frames, 1);
  EXPECT_EQ(found.assets, 1);
}

TEST_F(StoreCheckTest, FlippedByteInBlockIsAFault) {
  std::fstream file(path() + "/segments/open/0.seg", std::ios::in | std::ios::out);
  file.seekp(77);
  file << 'z';
  file.close();
  expect_fault("digest mismatch");
}

TEST_F(StoreCheckTest, ShortSegmentIsAFault) {
  std::filesystem::resize_file(path() + "/segments/open/0.seg", 7000);
  expect_fault("unit (0, 1, 0)");
}

TEST_F(StoreCheckTest, MissingOrAlteredImageIsAFault) {
  write(path() + "/outputs/done/frame.exr", "an imago");
  expect_fault("outputs/done/frame.exr: digest mismatch");
  write(path() + "/outputs/done/frame.exr", "longer than it was");
  expect_fault("its row says 8");
  std::filesystem::remove(path() + "/outputs/done/frame.exr");
  expect_fault("outputs/done/frame.exr");
}

TEST_F(StoreCheckTest, AlteredAssetIsAFault) {
  std::filesystem::permissions(asset_, std::filesystem::perms::owner_all);
  write(asset_, "an asser");
  expect_fault("digest mismatch");
}

TEST_F(StoreCheckTest, OverlappingBlocksAreAFault) {
  change_rows("UPDATE units SET offset=4999 WHERE job=1 AND tile=1");
  const StoreFindings found = check();  // its digest is wrong, too
  ASSERT_EQ(found.faults.size(), 2u) << ::testing::PrintToString(found.faults);
  EXPECT_TRUE(absl::StrContains(found.faults[0], "overlaps another one")) << found.faults[0];
}

TEST_F(StoreCheckTest, BlockReleasedTooEarlyIsAFault) {
  change_rows("UPDATE jobs SET first_segment=1 WHERE id='open'");
  const StoreFindings found = check();
  ASSERT_EQ(found.faults.size(), 2u) << ::testing::PrintToString(found.faults);
  EXPECT_TRUE(absl::StrContains(found.faults[0], "is not finished")) << found.faults[0];
}

TEST_F(StoreCheckTest, ImageWithoutRowIsAnOrphan) {
  change_rows("DELETE FROM frames");
  const StoreFindings found = check();
  ASSERT_EQ(found.orphans.size(), 1u);
  EXPECT_EQ(found.orphans[0], "outputs/done/frame.exr");
}

TEST_F(StoreCheckTest, DoneJobWithoutTotalsIsAFault) {
  change_rows("UPDATE jobs SET state=4 WHERE id='done'");
  EXPECT_TRUE(check().faults.empty());
  change_rows("UPDATE jobs SET state=4");
  EXPECT_EQ(check().faults.size(), 2u);
}

TEST_F(StoreCheckTest, ImpossibleTotalsAreAFault) {
  change_rows("UPDATE totals SET audited=9");
  expect_fault("totals of worker worker of job done: damaged");
  change_rows("UPDATE totals SET audited=0, job=77");
  expect_fault("no job 77");
}

TEST_F(StoreCheckTest, UnitsThatAreNotChargedAreAFault) {
  change_rows("UPDATE usage SET units=units-1");
  const StoreFindings found = check();
  ASSERT_FALSE(found.faults.empty());
  EXPECT_TRUE(absl::StrContains(found.faults[0], "account of job")) << found.faults[0];
  change_rows("UPDATE usage SET units=units+5");  // an extended job
  EXPECT_TRUE(check().faults.empty());
}

TEST_F(StoreCheckTest, UnitsOfRemovedJobAreAFault) {
  change_rows("UPDATE jobs SET removed=1 WHERE id='open'");
  EXPECT_GE(check().faults.size(), 2u);
}

TEST_F(StoreCheckTest, RemovedJobLeavesNothing) {
  {
    const auto store = Store::open(path(), real_filesystem());
    ASSERT_TRUE(store.ok()) << store.status();
    for (const char* id : {"open", "done"}) EXPECT_TRUE((*store)->jobs().remove(id).ok());
  }
  const StoreFindings found = check();
  EXPECT_TRUE(found.faults.empty()) << ::testing::PrintToString(found.faults);
  EXPECT_TRUE(found.orphans.empty()) << ::testing::PrintToString(found.orphans);
  EXPECT_EQ(found.jobs + found.units + found.frames, 0);
}

TEST_F(StoreCheckTest, FilesWithoutRowAreOrphans) {
  write(path() + "/segments/open/7.seg", "x");
  write(path() + "/assets/upload/1-1", "x");
  const StoreFindings found = check();
  EXPECT_TRUE(found.faults.empty()) << ::testing::PrintToString(found.faults);
  EXPECT_EQ(found.orphans.size(), 2u) << ::testing::PrintToString(found.orphans);
}

TEST_F(StoreCheckTest, BusyOrMissingStoreIsRefused) {
  {
    const auto store = Store::open(path(), real_filesystem());
    EXPECT_TRUE(absl::IsFailedPrecondition(check_store(path(), real_filesystem()).status()));
  }
  EXPECT_TRUE(absl::IsNotFound(check_store(path() + "/no", real_filesystem()).status()));
}

TEST_F(StoreCheckTest, StoreOfOtherSchemaIsRefused) {
  const std::string own = std::to_string(schema_version());
  change_rows("PRAGMA user_version=1");
  const absl::Status older = check_store(path(), real_filesystem()).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(older));
  EXPECT_EQ(older.message(),
            "the store has schema 1, written by an older version; start this version's server on "
            "it once, which migrates it to schema " +
                own);
  const std::string next = std::to_string(schema_version() + 1);
  change_rows(("PRAGMA user_version=" + next).c_str());
  const absl::Status newer = check_store(path(), real_filesystem()).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(newer));
  EXPECT_EQ(newer.message(), "the store has schema " + next +
                                 ", written by a newer version; this version reads schema " + own +
                                 " and older: upgrade this program");
}

TEST_F(StoreCheckTest, CheckChangesNothing) {
  change_rows("UPDATE store SET boot_count=41");
  const auto before = std::filesystem::last_write_time(path() + "/store.db");
  check();
  EXPECT_EQ(std::filesystem::last_write_time(path() + "/store.db"), before);
  std::int64_t boots = 0;
  const auto rows = Database::open(path() + "/store.db", "", Database::Mode::reader);
  ASSERT_TRUE(rows.ok()) << rows.status();
  ASSERT_TRUE((*rows)
                  ->each("SELECT boot_count FROM store", {},
                         [&](const SqlRow& row) { boots = row.integer(0); })
                  .ok());
  EXPECT_EQ(boots, 41);
}

}  // namespace
}  // namespace tessera::server
