// A coordinator over a real store in which files of removed and finished jobs cannot be deleted.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/coordinator/coordinator.h"
#include "tests/support/disk/failing_disk.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {
namespace {

class UndeletedFiles : public ::testing::Test {
 protected:
  void SetUp() override { start(); }

  void start() {
    coordinator_.reset();
    store_.reset();
    StoreOptions store_options;
    store_options.row_block_bytes = 0;  // blocks are files
    store_options.warn = [this](const std::string& line) { warnings_.push_back(line); };
    store_ = Store::open(folder_.path() + "/store", disk_, store_options).value();
    FarmOptions options;
    options.clock = [] { return std::chrono::steady_clock::now(); };
    options.wall_us = [] { return std::int64_t{1'700'000'000'000'000}; };
    options.random = [this] { return random_ += 0x9E3779B97F4A7C15u; };
    options.write_request = [](const JobSpec& spec) { return spec.request; };
    options.read_spec = [](const JobRecord& record) -> absl::StatusOr<JobSpec> {
      JobSpec spec;
      spec.id = record.id;
      spec.name = spec.request_id = spec.request = record.request;
      return spec;
    };
    coordinator_ = Coordinator::open(*store_, options).value();
  }
  void pump() {
    while (coordinator_->run_writer(false) || coordinator_->run_answers(false)) {
    }
  }
  void create(const std::string& request) {
    JobSpec spec;
    spec.name = spec.request_id = spec.request = request;
    coordinator_->admission().create_job(spec, [&](const auto& job) { created_ = job; });
  }
  /// Returns the ID of a cancelled job with one block.
  std::string cancelled_job(const std::string& request) {
    create(request);
    pump();
    Commit unit;
    unit.job_id = created_->view.spec->id;
    unit.block = std::string(10'000, 'b');
    unit.record.sha256 = contract::sha256(unit.block);
    unit.record.stored_bytes = static_cast<std::int64_t>(unit.block.size());
    std::vector<Commit> group = {unit};
    EXPECT_TRUE(store_->units().commit(group).ok());
    coordinator_->jobs().change_job(unit.job_id, JobAdmin::Change::cancel, [](const auto&) {});
    pump();
    EXPECT_TRUE(std::filesystem::exists(segments_of(unit.job_id)));
    return unit.job_id;
  }
  void remove(const std::string& job_id) {
    coordinator_->jobs().remove_job(job_id, [&](const absl::Status& status) { removed_ = status; });
  }
  bool is_listed(const std::string& job_id) const {
    return coordinator_->queries().job(job_id).ok();
  }
  std::string segments_of(const std::string& job_id) const {
    return folder_.path() + "/store/segments/" + job_id;
  }
  /// Returns how often the removal of a job was told.
  std::ptrdiff_t removal_events(const std::string& job_id) const {
    const auto events = coordinator_->farm().events().read({}, 100);
    return std::count_if(events.begin(), events.end(), [&](const Event& event) {
      return event.kind == EventKind::job_removed && event.job_id == job_id;
    });
  }

  ScratchFolder folder_;
  testing::FailingDisk disk_;
  std::vector<std::string> warnings_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<Coordinator> coordinator_;
  absl::StatusOr<JobAdmission::Created> created_ = absl::UnknownError("no answer");
  absl::Status removed_ = absl::UnknownError("no answer");
  std::uint64_t random_ = 42;
};

TEST_F(UndeletedFiles, JobIsRemovedAndNextStartDeletesThem) {
  const std::string job = cancelled_job("a");
  const std::int64_t before = store_->used_bytes();
  disk_.fail_removing(segments_of(job));
  remove(job);
  pump();
  EXPECT_TRUE(removed_.ok()) << removed_;
  EXPECT_FALSE(is_listed(job));
  EXPECT_EQ(removal_events(job), 1);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find(segments_of(job)), std::string::npos) << warnings_[0];
  EXPECT_NE(warnings_[0].find("next start"), std::string::npos) << warnings_[0];
  EXPECT_TRUE(std::filesystem::exists(segments_of(job)));
  disk_.recover();
  start();
  EXPECT_FALSE(is_listed(job));
  EXPECT_EQ(removal_events(job), 1);
  EXPECT_FALSE(std::filesystem::exists(segments_of(job)));
  EXPECT_LT(store_->used_bytes(), before - 9'000);
}

TEST_F(UndeletedFiles, JobsRemovedWithItHaveOwnOutcome) {
  const std::string job = cancelled_job("a"), other = cancelled_job("b");
  disk_.fail_removing(segments_of(job));
  remove(job);
  remove(other);
  pump();
  EXPECT_TRUE(removed_.ok()) << removed_;
  EXPECT_FALSE(is_listed(other));
  EXPECT_FALSE(std::filesystem::exists(segments_of(other)));
  EXPECT_EQ(warnings_.size(), 1u);
}

TEST_F(UndeletedFiles, WritesOfTheSameTransactionSucceed) {
  const std::string job = cancelled_job("a");
  disk_.fail_removing(segments_of(job));
  JobRecord beside;
  beside.id = beside.request_id = "beside";
  const absl::Status together = store_->write_together([&] {
    EXPECT_TRUE(store_->units().close_job(job).ok());
    EXPECT_TRUE(store_->jobs().add(beside).ok());
  });
  EXPECT_TRUE(together.ok()) << together;
  ASSERT_EQ(warnings_.size(), 1u);
  disk_.recover();
  start();
  EXPECT_FALSE(std::filesystem::exists(segments_of(job)));
}

}  // namespace
}  // namespace tessera::server
