// back_up_store(): the copy of a store in use is complete, independent, and never left half done.
#include "server/store/maintenance/backup.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "server/store/sqlite/database.h"
#include "server/store/store.h"
#include "tests/support/disk/failing_disk.h"
#include "tests/support/disk/older_schema.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/server/store/durability_checker.h"

namespace tessera::server {
namespace {

void write(const std::string& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

/// An open store with an asset, a finished frame, and a job of two blocks.
class BackupTest : public ::testing::Test {
 protected:
  BackupTest() {
    auto opened = Store::open(path(), real_filesystem(), files_only());
    EXPECT_TRUE(opened.ok()) << opened.status();
    store_ = *std::move(opened);
    for (const char* id : {"open", "done"}) {
      JobRecord job;
      job.id = id;
      EXPECT_TRUE(store_->jobs().add(job).ok());
      commit(id, 0);
      commit(id, 1);
    }
    write(store_->frames().output_folder("done").value() + "/frame.exr", "an image");
    FrameRecord frame;
    frame.file = "frame.exr";
    frame.file_sha256 = contract::sha256("an image");
    EXPECT_TRUE(store_->frames().finish("done", frame).ok());
    EXPECT_TRUE(store_->units().close_job("done").ok());
    const std::string upload = store_->assets().new_upload_path().value();
    write(upload, "an asset");
    EXPECT_TRUE(store_->assets().publish(upload, contract::sha256("an asset")).ok());
  }

  std::string path() const { return folder_.path() + "/store"; }
  std::string copy() const { return folder_.path() + "/copy"; }

  void commit(const std::string& job, std::int32_t tile) {
    std::vector<Commit> group = {make_commit(job, {0, tile, 0}, std::string(5000, 'x'))};
    EXPECT_TRUE(store_->units().commit(group).ok());
  }

  ScratchFolder folder_;
  std::unique_ptr<Store> store_;
};

TEST_F(BackupTest, CopyOfLiveStoreIsComplete) {
  const auto findings = back_up_store(path(), copy(), real_filesystem());
  ASSERT_TRUE(findings.ok()) << findings.status();
  EXPECT_EQ(findings->jobs, 2);
  EXPECT_EQ(findings->units, 4);
  EXPECT_EQ(findings->blocks, 2) << "released blocks are not copied";
  EXPECT_EQ(findings->frames, 1);
  EXPECT_EQ(findings->assets, 1);
  EXPECT_TRUE(findings->orphans.empty()) << ::testing::PrintToString(findings->orphans);

  commit("open", 2);  // the original is still in use
  const auto restored = Store::open(copy(), real_filesystem());
  ASSERT_TRUE(restored.ok()) << restored.status();
  EXPECT_NE((*restored)->id(), store_->id()) << "workers could confuse the two";
  EXPECT_EQ((*restored)->key(), store_->key()) << "session keys would be void";
  int units = 0;
  const absl::Status read = (*restored)->units().for_each("open", [&](const UnitRecord& record) {
    EXPECT_EQ((*restored)->units().read_block("open", record).value(), std::string(5000, 'x'));
    ++units;
  });
  EXPECT_TRUE(read.ok()) << read;
  EXPECT_EQ(units, 2) << "rows must be from one snapshot";
}

TEST_F(BackupTest, CompletesWhileJobsEnd) {
  testing::FailingDisk disk;
  std::string running = "open";
  int ended_count = 0;
  disk.before_open([&](const std::string& file) {  // before a segment of the store is copied
    if (file.rfind(path() + "/", 0) != 0 || file.find("segments") == std::string::npos) return;
    EXPECT_TRUE(store_->units().close_job(running).ok());
    JobRecord job;
    running = job.id = "job" + std::to_string(++ended_count);
    EXPECT_TRUE(store_->jobs().add(job).ok());
    commit(running, 0);
  });
  const auto findings = back_up_store(path(), copy(), disk);
  ASSERT_TRUE(findings.ok()) << findings.status();
  EXPECT_EQ(findings->blocks, 2) << "as of the moment at which it began";
  EXPECT_EQ(ended_count, 1);
  for (const auto& entry : std::filesystem::directory_iterator(path())) {
    EXPECT_NE(entry.path().filename().string().substr(0, 6), "backup") << entry.path();
  }
}

TEST_F(BackupTest, FullDiskLeavesNoPart) {
  testing::FailingDisk disk;
  disk.fail_write_after(100);
  const auto findings = back_up_store(path(), copy(), disk);
  EXPECT_TRUE(absl::IsResourceExhausted(findings.status())) << findings.status();
  EXPECT_FALSE(std::filesystem::exists(copy() + ".part"));
}

TEST_F(BackupTest, JoinTokensAreCopied) {
  std::filesystem::create_directory(path() + "/tokens");
  write(path() + "/tokens/0123abcd", "sha256 …");
  ASSERT_TRUE(back_up_store(path(), copy(), real_filesystem()).ok());
  EXPECT_TRUE(std::filesystem::exists(copy() + "/tokens/0123abcd"));
}

TEST_F(BackupTest, ExistingFilesAreNotOverwritten) {
  std::filesystem::create_directory(copy());
  EXPECT_TRUE(absl::IsAlreadyExists(back_up_store(path(), copy(), real_filesystem()).status()));
  EXPECT_TRUE(
      absl::IsNotFound(back_up_store(folder_.path(), copy() + "2", real_filesystem()).status()));
}

TEST_F(BackupTest, DamagedStoreGivesNoCopy) {
  std::fstream file(path() + "/segments/open/0.seg", std::ios::in | std::ios::out);
  file.seekp(77);
  file << 'z';
  file.close();
  const auto findings = back_up_store(path(), copy(), real_filesystem());
  EXPECT_TRUE(absl::IsDataLoss(findings.status())) << findings.status();
  EXPECT_FALSE(std::filesystem::exists(copy()));
  EXPECT_FALSE(std::filesystem::exists(copy() + ".part"));
}

TEST_F(BackupTest, StoreOfOlderSchemaGivesNoCopy) {
  store_.reset();
  {
    const auto rows = Database::open(path() + "/store.db", "", Database::Mode::writer);
    ASSERT_TRUE(rows.ok()) << rows.status();
    ASSERT_TRUE((*rows)->script(sql_to_older_schema(1).c_str()).ok());
  }
  const absl::Status status = back_up_store(path(), copy(), real_filesystem()).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_NE(status.message().find("has schema 1, written by an older version"), std::string::npos)
      << status;
  EXPECT_FALSE(std::filesystem::exists(copy()));
}

TEST_F(BackupTest, MissingFileGivesNoCopy) {
  std::filesystem::remove(path() + "/outputs/done/frame.exr");
  const auto findings = back_up_store(path(), copy(), real_filesystem());
  EXPECT_TRUE(absl::IsDataLoss(findings.status())) << findings.status();
  EXPECT_FALSE(std::filesystem::exists(copy()));
}

}  // namespace
}  // namespace tessera::server
