// Assets as files and, if they are small, as rows.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "server/store/maintenance/backup.h"
#include "server/store/maintenance/check.h"
#include "server/store/sqlite/database.h"
#include "tests/unit/server/store/store_fixture.h"

namespace tessera::server {
namespace {

using AssetsTest = StoreFixture;

class SmallAssetsTest : public AssetsTest {
 protected:
  SmallAssetsTest() {
    uses_rows_ = true;
    open();
  }
  void change_rows(const char* sql) {
    store_.reset();
    const auto rows = Database::open(path() + "/store.db", "", Database::Mode::writer);
    ASSERT_TRUE(rows.ok()) << rows.status();
    const absl::Status changed = (*rows)->script(sql);
    ASSERT_TRUE(changed.ok()) << changed;
  }
};

/// True: as rows.
class AnyAssets : public AssetsTest, public ::testing::WithParamInterface<bool> {
 protected:
  AnyAssets() {
    uses_rows_ = GetParam();
    open();
  }
};
INSTANTIATE_TEST_SUITE_P(Rows, AnyAssets, ::testing::Bool());

TEST_F(AssetsTest, AssetIsVisibleOncePublished) {
  const contract::Digest digest = contract::sha256("texture");
  const std::string upload_path = *store().assets().new_upload_path();
  EXPECT_NE(*store().assets().new_upload_path(), upload_path);
  write_file(upload_path, "texture");
  EXPECT_FALSE(store().assets().has(digest));
  EXPECT_FALSE(std::filesystem::exists(asset_file(path(), digest)));
  ASSERT_TRUE(store().assets().publish(upload_path, digest).ok());
  EXPECT_EQ(upload("texture"), digest);  // uploading the same again is harmless
  open();
  EXPECT_TRUE(store().assets().has(digest));
  EXPECT_EQ(read_file(asset_file(path(), digest)), "texture");
  EXPECT_EQ(read_asset(store(), digest), "texture");
}

TEST_F(AssetsTest, PublishingMissingUploadIsNotFound) {
  AssetStore& assets = store().assets();
  const auto status = assets.publish(*assets.new_upload_path(), contract::sha256("x"));
  EXPECT_TRUE(absl::IsNotFound(status)) << status;
  EXPECT_FALSE(assets.has(contract::sha256("x")));
  EXPECT_TRUE(absl::IsNotFound(assets.open(contract::sha256("x")).status()));
}

TEST_P(AnyAssets, OldestAreCollected) {
  const contract::Digest named = upload(std::string(100, 'n'));
  const contract::Digest oldest = upload(std::string(100, 'o'));
  now_us_ += 1;
  const contract::Digest older = upload(std::string(100, 'p'));
  now_us_ += 2 * kHourUs;
  const contract::Digest fresh = upload(std::string(100, 'f'));
  ASSERT_TRUE(store().assets().collect(now_us_, 400, {}).ok());
  EXPECT_TRUE(store().assets().has(oldest)) << "the quota is kept";
  ASSERT_TRUE(store().assets().collect(now_us_, 301, {named}).ok());
  EXPECT_FALSE(store().assets().has(oldest));
  EXPECT_EQ(read_asset(store(), oldest), "");
  EXPECT_EQ(file_count("assets"), uses_rows_ ? 0 : 3);
  EXPECT_TRUE(store().assets().has(older));
  ASSERT_TRUE(store().assets().collect(now_us_, 0, {named}).ok());
  EXPECT_FALSE(store().assets().has(older));
  EXPECT_TRUE(store().assets().has(fresh)) << "uploaded within the hour";
  EXPECT_TRUE(store().assets().has(named));
  EXPECT_EQ(store().assets().used_bytes(), 200);
  now_us_ += kHourUs;
  upload(std::string(100, 'f'));  // keeps it for another hour
  ASSERT_TRUE(store().assets().collect(now_us_, 0, {named}).ok());
  EXPECT_TRUE(store().assets().has(fresh));
  expect_consistent();
  EXPECT_EQ(store().assets().used_bytes(), 200);
}

TEST_P(AnyAssets, ReleasedIsCollectedLast) {
  const contract::Digest reused = upload(std::string(100, 'r'));
  now_us_ += 1;
  const contract::Digest unused = upload(std::string(100, 'u'));
  now_us_ += 2 * kHourUs;
  ASSERT_TRUE(store().assets().release({reused}).ok());
  ASSERT_TRUE(store().assets().collect(now_us_, 100, {}).ok());
  EXPECT_TRUE(store().assets().has(reused));
  EXPECT_FALSE(store().assets().has(unused));
}

TEST_P(AnyAssets, DamagedOneIsDropped) {
  const contract::Digest digest = upload(std::string(100, 'd')), other = upload("other");
  const std::int64_t damaged_us = store().assets().open(digest)->stored_us();
  ASSERT_TRUE(store().assets().drop(digest, damaged_us).ok());
  EXPECT_FALSE(store().assets().has(digest));
  EXPECT_TRUE(store().assets().has(other));
  EXPECT_EQ(file_count("assets"), uses_rows_ ? 0 : 1);
  EXPECT_EQ(store().assets().used_bytes(), 5);
  ASSERT_TRUE(store().assets().drop(digest, damaged_us).ok()) << "by another reader";
  now_us_ += 1;
  upload(std::string(100, 'd'));
  ASSERT_TRUE(store().assets().drop(digest, damaged_us).ok());
  EXPECT_EQ(read_asset(store(), digest), std::string(100, 'd')) << "it was stored again";
  expect_consistent();
}

TEST_P(AnyAssets, AreReadInParts) {
  const contract::Digest empty = upload("");
  const std::string bytes = std::string(30'000, 'a') + std::string(40'000, 'b');
  const contract::Digest large = upload(bytes);
  EXPECT_TRUE(store().assets().has(empty));
  EXPECT_EQ(store().assets().open(empty)->size(), 0);
  const auto asset = store().assets().open(large);
  ASSERT_TRUE(asset.ok()) << asset.status();
  EXPECT_EQ(asset->size(), 70'000);
  std::string part(20'000, '\0');
  ASSERT_TRUE(asset->read_at(20'000, part).ok());
  EXPECT_EQ(part, bytes.substr(20'000, 20'000));
  EXPECT_TRUE(absl::IsOutOfRange(asset->read_at(60'000, part)));
}

TEST_F(SmallAssetsTest, HasNoFile) {
  const contract::Digest digest = upload("texture");
  EXPECT_EQ(upload("texture"), digest);
  for (int life = 0; life < 2; ++life) {
    EXPECT_EQ(file_count("assets"), 0);
    EXPECT_TRUE(store().assets().has(digest));
    EXPECT_EQ(read_asset(store(), digest), "texture");
    EXPECT_EQ(store().assets().used_bytes(), 7);
    expect_consistent();
  }
  upload(std::string(70'000, 'l'));
  EXPECT_EQ(file_count("assets"), 1);
  EXPECT_EQ(store().assets().used_bytes(), 70'007);
  expect_consistent();
}

TEST_F(SmallAssetsTest, ManyShareTransaction) {
  const absl::Status together = store().write_together([&] {
    upload("a");
    upload("b");
    upload("a");
    EXPECT_EQ(store().assets().used_bytes(), 0) << "not yet durable";
  });
  ASSERT_TRUE(together.ok()) << together;
  EXPECT_EQ(store().assets().used_bytes(), 2) << "the same asset counts once";
  EXPECT_EQ(read_asset(store(), contract::sha256("b")), "b");
}

TEST_F(SmallAssetsTest, RowCountsAsDatabaseOnly) {
  const std::int64_t content = store().used_bytes();
  upload(std::string(3000, 'x'));
  const auto grown = static_cast<std::int64_t>(std::filesystem::file_size(path() + "/store.db"));
  EXPECT_LE(store().used_bytes() - content, std::max<std::int64_t>(grown, 8192));
  upload(std::string(70'000, 'y'));
  EXPECT_GE(store().used_bytes() - content, 70'000);
  EXPECT_EQ(store().assets().used_bytes(), 73'000);
}

TEST_F(SmallAssetsTest, LostFileComesBackAsRow) {
  uses_rows_ = false;
  open();
  const contract::Digest lost = upload("lost"), kept = upload("kept"), shorter = upload("shorter");
  uses_rows_ = true;
  open();
  std::filesystem::remove(asset_file(path(), lost));
  std::filesystem::resize_file(asset_file(path(), shorter), 3);
  EXPECT_FALSE(store().assets().has(lost));
  upload("lost");
  upload("kept");
  upload("shorter");
  EXPECT_EQ(file_count("assets"), 1) << "an old file is used as long as it is complete";
  EXPECT_EQ(read_asset(store(), lost), "lost");
  EXPECT_EQ(read_asset(store(), kept), "kept");
  EXPECT_EQ(read_asset(store(), shorter), "shorter");
  EXPECT_EQ(store().assets().used_bytes(), 15);
  expect_consistent();
}

TEST_F(SmallAssetsTest, FileLeftBesideItsRowIsDeleted) {
  const contract::Digest digest = upload("texture");
  const std::string file = asset_file(path(), digest);
  std::filesystem::create_directories(std::filesystem::path(file).parent_path());
  write_file(file, "tex");  // as after a crash
  open();
  EXPECT_EQ(file_count("assets"), 0);
  EXPECT_EQ(read_asset(store(), digest), "texture");
}

TEST_F(SmallAssetsTest, DamagedRowIsUploadedAgain) {
  const contract::Digest digest = upload("texture");
  for (const char* damage :
       {"DELETE FROM asset_contents", "UPDATE asset_contents SET contents='t'"}) {
    change_rows(damage);
    open();
    EXPECT_FALSE(store().assets().has(digest)) << damage;
    upload("texture");
    EXPECT_EQ(read_asset(store(), digest), "texture") << damage;
    EXPECT_EQ(store().assets().used_bytes(), 7) << damage;
  }
  change_rows("UPDATE asset_contents SET contents='t'");
  uses_rows_ = false;
  open();
  upload("texture");
  EXPECT_EQ(read_file(asset_file(path(), digest)), "texture");
  EXPECT_EQ(read_asset(store(), digest), "texture");
  expect_consistent();
}

TEST_F(SmallAssetsTest, CheckFindsDamagedRows) {
  upload("texture");
  const auto faults = [&](const char* sql) {
    change_rows(sql);
    const auto findings = check_store(path(), real_filesystem());
    EXPECT_TRUE(findings.ok()) << findings.status();
    return findings.ok() && findings->faults.size() == 1 ? findings->faults[0] : "none";
  };
  EXPECT_NE(faults("UPDATE asset_contents SET contents=CAST('Texture' AS BLOB)").find("mismatch"),
            std::string::npos);
  EXPECT_NE(faults("UPDATE asset_contents SET contents=CAST('t' AS BLOB)").find("has 1 bytes"),
            std::string::npos);
  EXPECT_NE(faults("DELETE FROM asset_contents").find("No such file"), std::string::npos);
  EXPECT_NE(faults("DELETE FROM assets; INSERT INTO asset_contents VALUES('s', 'c')")
                .find("no such asset"),
            std::string::npos);
}

TEST_F(SmallAssetsTest, BackupHasRowsAndFiles) {
  const contract::Digest small = upload("texture");
  const std::string bytes(70'000, 'l');
  const contract::Digest large = upload(bytes);
  const std::string copy = folder_.path() + "/copy";
  const auto findings = back_up_store(path(), copy, real_filesystem());
  ASSERT_TRUE(findings.ok()) << findings.status();
  EXPECT_EQ(findings->assets, 2);
  const auto restored = Store::open(copy, real_filesystem());
  ASSERT_TRUE(restored.ok()) << restored.status();
  EXPECT_EQ(read_asset(**restored, small), "texture");
  EXPECT_EQ(read_asset(**restored, large), bytes);
}

}  // namespace
}  // namespace tessera::server
