#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/store/maintenance/check.h"
#include "server/store/store.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/server/store/durability_checker.h"

namespace tessera::server {

/// A store in a private folder that can be reopened as after the end of the process.
class StoreFixture : public ::testing::Test {
 protected:
  StoreFixture() { open(); }

  void open() {
    store_.reset();
    StoreOptions options = uses_rows_ ? StoreOptions() : files_only();
    options.segment_bytes = segment_bytes_;
    options.slack_pages = slack_pages_;
    options.checkpoint_pages = checkpoint_pages_;
    options.now_us = [this] { return now_us_; };
    options.max_events = max_events_;
    options.max_removed_jobs = max_removed_jobs_;
    auto store = Store::open(path(), real_filesystem(), options);
    ASSERT_TRUE(store.ok()) << store.status();
    store_ = *std::move(store);
  }

  std::string path() const { return folder_.path() + "/store"; }
  Store& store() { return *store_; }

  JobRecord add_job(const std::string& id) {
    JobRecord job;
    job.id = id;
    job.request_id = "request-" + id;
    job.name = "a name, with 'quotes'";
    job.owner = "owner";
    job.request = std::string("\0bytes\xff", 7);
    job.create_time_us = 1234567;
    job.render_contract = 3;
    EXPECT_TRUE(store().jobs().add(job).ok());
    return job;
  }

  std::vector<Commit> commit(const std::string& job_id, int frame, int tile_count,
                             std::size_t block_bytes = 100) {
    std::vector<Commit> group;
    for (int tile = 0; tile < tile_count; ++tile) {
      const char letter = static_cast<char>('a' + tile % 26);
      group.push_back(make_commit(job_id, {frame, tile, 0}, std::string(block_bytes, letter)));
    }
    const absl::Status status = store().units().commit(group);
    EXPECT_TRUE(status.ok()) << status;
    return group;
  }

  std::vector<UnitRecord> units(const std::string& job_id) {
    std::vector<UnitRecord> records;
    const absl::Status status = store().units().for_each(
        job_id, [&](const UnitRecord& record) { records.push_back(record); });
    EXPECT_TRUE(status.ok()) << status;
    return records;
  }

  void write_file(const std::string& file, const std::string& bytes) {
    std::ofstream(file, std::ios::binary) << bytes;
  }

  int file_count(const std::string& folder) const {
    int count = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(path() + "/" + folder)) {
      count += entry.is_regular_file() ? 1 : 0;
    }
    return count;
  }
  /// Checks the closed store and opens it again.
  void expect_consistent() {
    store_.reset();
    const auto findings = check_store(path(), real_filesystem());
    ASSERT_TRUE(findings.ok()) << findings.status();
    EXPECT_EQ(findings->faults, std::vector<std::string>());
    EXPECT_EQ(findings->orphans, std::vector<std::string>());
    open();
  }

  FrameRecord finish_frame(const std::string& job_id, int frame, const std::string& bytes) {
    FrameRecord record;
    record.frame = frame;
    record.file = "image." + std::to_string(frame) + ".exr";
    record.file_sha256 = contract::sha256(bytes);
    record.pixels_sha256 = contract::sha256("pixels");
    record.statistics_json = R"({"frame": 1})";
    if (static_cast<std::int64_t>(bytes.size()) <= store().frames().max_row_bytes()) {
      EXPECT_TRUE(store().frames().finish_small(job_id, record, bytes).ok());
      return record;
    }
    write_file(*store().frames().output_folder(job_id) + "/" + record.file, bytes);
    EXPECT_TRUE(store().frames().finish(job_id, record).ok());
    return record;
  }

  /// As the asset service does it.
  contract::Digest upload(const std::string& bytes) {
    if (static_cast<std::int64_t>(bytes.size()) <= store().assets().max_row_bytes()) {
      EXPECT_TRUE(store().assets().add(contract::sha256(bytes), bytes).ok());
      return contract::sha256(bytes);
    }
    const std::string upload = *store().assets().new_upload_path();
    write_file(upload, bytes);
    EXPECT_TRUE(store().assets().publish(upload, contract::sha256(bytes)).ok());
    EXPECT_FALSE(std::filesystem::exists(upload));
    return contract::sha256(bytes);
  }

  ScratchFolder folder_;
  bool uses_rows_ = false;  // for small blocks, images and assets
  std::unique_ptr<Store> store_;
  std::int64_t segment_bytes_ = 1 << 20;
  int slack_pages_ = 256, checkpoint_pages_ = 2000;
  std::int64_t now_us_ = 100 * kHourUs;
  std::int64_t max_events_ = 200'000;
  std::int64_t max_removed_jobs_ = 200'000;
};

}  // namespace tessera::server
