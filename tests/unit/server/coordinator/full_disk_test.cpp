// A coordinator over a real store whose disk is full.
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "server/coordinator/coordinator.h"
#include "tests/support/disk/failing_disk.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {
namespace {

class FullDisk : public ::testing::Test {
 protected:
  void SetUp() override {
    store_ = Store::open(folder_.path() + "/store", disk_).value();
    FarmOptions options;
    options.clock = [] { return std::chrono::steady_clock::now(); };
    options.wall_us = [] { return std::int64_t{1'700'000'000'000'000}; };
    options.random = [this] { return random_ += 0x9E3779B97F4A7C15u; };
    options.write_request = [](const JobSpec& spec) { return spec.request; };
    coordinator_ = Coordinator::open(*store_, options).value();
  }
  /// Asks for a job, whose ID or error is added to `answers`.
  void create(const std::string& request, std::vector<std::string>& answers) {
    JobSpec spec;
    spec.name = spec.request_id = spec.request = request;
    coordinator_->admission().create_job(spec, [&](const auto& created) {
      answers.push_back(created.ok() ? created->view.spec->id : created.status().ToString());
    });
  }
  void pump() {
    while (coordinator_->run_writer(false) || coordinator_->run_answers(false)) {
    }
  }

  ScratchFolder folder_;
  testing::FailingDisk disk_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<Coordinator> coordinator_;
  std::uint64_t random_ = 42;
};

TEST_F(FullDisk, ErrorNamesDiskAndWhatToDo) {
  std::vector<std::string> answers;
  disk_.fail_sqlite_writes("store.db-wal");
  create("first", answers);
  pump();
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_NE(answers.front().find("RESOURCE_EXHAUSTED: the disk of " + folder_.path() +
                                 "/store/store.db is full ("),
            std::string::npos)
      << answers.front();
  EXPECT_NE(answers.front().find("remove ended jobs with `tessera remove`"), std::string::npos);
}

TEST_F(FullDisk, JobIsCreatedBesideCancelThatTakesReserve) {
  std::vector<std::string> answers;
  create("first", answers);
  pump();
  ASSERT_EQ(answers.size(), 1u);
  const std::string first = answers.front();
  disk_.fail_sqlite_writes("store.db-wal");
  disk_.recover_when_removed("ballast");
  create("second", answers);
  absl::Status cancelled = absl::UnknownError("no answer");
  coordinator_->jobs().change_job(first, JobAdmin::Change::cancel,
                                  [&](const auto& view) { cancelled = view.status(); });
  pump();
  EXPECT_TRUE(cancelled.ok()) << cancelled;
  ASSERT_EQ(answers.size(), 2u);
  EXPECT_TRUE(coordinator_->queries().job(answers.back()).ok()) << answers.back();
  create("second", answers);
  pump();
  EXPECT_EQ(answers[1], answers[2]) << "the same request is the same job";
}

}  // namespace
}  // namespace tessera::server
