// Blocks and images of small jobs, which are rows of the database instead of files.

#include <gtest/gtest.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "server/store/maintenance/check.h"
#include "tests/unit/server/store/store_fixture.h"

namespace tessera::server {
namespace {

class SmallJobTest : public StoreFixture {
 protected:
  SmallJobTest() {
    uses_rows_ = true;
    open();
  }
};

TEST_F(SmallJobTest, BlocksAndImagesHaveNoFiles) {
  add_job("a");
  const std::vector<Commit> group = commit("a", 0, 4, 1000);
  finish_frame("a", 0, "image");
  for (int life = 0; life < 2; ++life) {
    EXPECT_EQ(file_count("segments") + file_count("outputs"), 0);
    for (const Commit& unit : group) {
      EXPECT_EQ(store().units().read_block("a", unit.record).value_or(""), unit.block);
    }
    EXPECT_EQ(store().frames().row_image("a", 0).value(), std::optional<std::string>("image"));
    EXPECT_EQ(units("a").size(), 4U);
    expect_consistent();
  }
  ASSERT_TRUE(store().units().close_job("a").ok());
  EXPECT_TRUE(absl::IsNotFound(store().units().read_block("a", group[0].record).status()));
  EXPECT_EQ(store().frames().row_image("a", 0).value(), std::optional<std::string>("image"));
  expect_consistent();
  ASSERT_TRUE(store().jobs().remove("a").ok());
  EXPECT_EQ(store().frames().row_image("a", 0).value(), std::nullopt);
  expect_consistent();
}

TEST_F(SmallJobTest, JobThatGrowsContinuesInSegments) {
  add_job("a");
  std::vector<Commit> all;
  for (int frame = 0; frame < 4; ++frame) {
    for (Commit& unit : commit("a", frame, 5, 10'000)) all.push_back(std::move(unit));
  }
  EXPECT_EQ(file_count("segments"), 1);
  for (Commit& unit : commit("a", 4, 1, 100)) {  // small, but the job is not
    EXPECT_GE(unit.record.segment, 0);
    all.push_back(std::move(unit));
  }
  for (const Commit& unit : all) {
    EXPECT_EQ(store().units().read_block("a", unit.record).value_or(""), unit.block);
  }
  expect_consistent();
  add_job("b");
  commit("b", 0, 1, 20'000);  // too large for a row
  EXPECT_EQ(file_count("segments"), 2);
  ASSERT_TRUE(store().units().close_job("a").ok());
  ASSERT_TRUE(store().units().close_job("b").ok());
  EXPECT_EQ(file_count("segments"), 0);
}

TEST_F(SmallJobTest, FrameOfOtherSizeMovesBetweenRowAndFile) {
  add_job("a");
  finish_frame("a", 0, "image");
  const std::string large(100'000, 'i');
  finish_frame("a", 0, large);
  EXPECT_EQ(store().frames().row_image("a", 0).value(), std::nullopt);
  EXPECT_EQ(file_count("outputs"), 1);
  expect_consistent();
  finish_frame("a", 0, "image");
  EXPECT_EQ(store().frames().row_image("a", 0).value(), std::optional<std::string>("image"));
  EXPECT_EQ(file_count("outputs"), 0);
  expect_consistent();
}

TEST_F(SmallJobTest, FileLeftBesideItsRowIsDeleted) {
  add_job("a");
  const FrameRecord frame = finish_frame("a", 0, "image");
  write_file(*store().frames().output_folder("a") + "/" + frame.file,
             "image");  // as of an older version
  open();
  EXPECT_EQ(file_count("outputs"), 0);
}

TEST_F(SmallJobTest, StatisticsChangeWithoutTheImage) {
  add_job("a");
  const FrameRecord frame = finish_frame("a", 0, "image");
  ASSERT_TRUE(store().frames().update_statistics("a", 0, R"({"frame": 2})").ok());
  EXPECT_EQ(store().frames().list("a")->front().statistics_json, R"({"frame": 2})");
  EXPECT_EQ(store().frames().list("a")->front().file_sha256, frame.file_sha256);
  EXPECT_TRUE(absl::IsNotFound(store().frames().update_statistics("a", 1, "{}")));
  EXPECT_TRUE(absl::IsNotFound(store().frames().update_statistics("b", 0, "{}")));
}

}  // namespace
}  // namespace tessera::server
